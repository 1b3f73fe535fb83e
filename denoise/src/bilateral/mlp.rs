//! The network that turns the secondary features of a pixel into the parameters of its filter (METHODS 9.5).
//!
//! ```text
//! z = clamp((v − μ) / (s + 1e-6), ±10)      36 secondary features in units of their standard deviation in training
//! h = sigmoid(W₁ z + b₁)                    10 hidden units
//! λ = softplus(clamp(W₂ h + b₂, −80, 10))   the six multipliers λ₀ to λ₅
//! ```
//!
//! One set of 436 weights for all pixels and sample counts. A feature that the picture has not is 0 after the
//! normalisation, its mean in training. The clamp of z is not the paper's: it keeps a pixel unlike any in training within
//! what was trained.

use std::path::Path;
use std::sync::LazyLock;

use serde_json::Value;

use super::secondary::{COUNT, names};
use crate::error::Error;
use crate::exp::exp_negative;
use crate::simd::Kernel;

/// Where the embedded weights come from.
const FILE: &str = "models/bilateral.json";

static EMBEDDED: LazyLock<Network> = LazyLock::new(|| {
    Network::parse(include_str!("../../../models/bilateral.json"), FILE.as_ref())
        .expect("a test reads the embedded weights")
});

/// Hidden units.
const HIDDEN: usize = 10;

/// Parameters of the filter that the network gives.
pub(super) const OUTPUTS: usize = 6;

/// Features farther from their mean than this many standard deviations count as that far.
const FARTHEST: f32 = 10.0;

/// Largest argument of the softplus, which keeps λ below 10.00005; below the smallest λ is 0 in effect.
const ARGUMENT: (f32, f32) = (-80.0, 10.0);

/// The weights of the network, the normalisation of its inputs, and the colour multiplier they were trained with.
#[derive(Clone, Debug, PartialEq)]
pub struct Network {
    mean: [f32; COUNT],
    /// `1 / (s + 1e-6)`.
    scale: [f32; COUNT],
    w1: [[f32; COUNT]; HIDDEN],
    b1: [f32; HIDDEN],
    w2: [[f32; HIDDEN]; OUTPUTS],
    b2: [f32; OUTPUTS],
    colour: f32,
}

impl Network {
    /// The trained weights that this program carries; their card is `models/bilateral.md`.
    pub fn embedded() -> &'static Self {
        &EMBEDDED
    }

    /// Reads weights as `train.py bilateral` writes them; `path` is what errors name.
    ///
    /// # Errors
    /// [`Error::Format`] where the text is no JSON, of another version, has not the 36 features in their order, or lacks
    /// a number or has one that is not finite.
    pub fn parse(text: &str, path: &Path) -> Result<Self, Error> {
        let file = File { path };
        let json: Value = serde_json::from_str(text).map_err(|error| {
            file.error(format!("no JSON ({error})"), "weights of the bilateral filter")
        })?;
        if json["version"] != 1 {
            return Err(file.error(format!("version {}", json["version"]), "version 1"));
        }
        let names = names();
        let found = json["features"].as_array().map_or(&[][..], Vec::as_slice);
        if found.len() != names.len() {
            return Err(file.error(format!("{} features", found.len()), "36 features"));
        }
        if let Some((found, name)) = found.iter().zip(&names).find(|(found, name)| *found != *name)
        {
            return Err(file.error(format!("the feature {found}"), format!("{name} in its place")));
        }
        let deviation: [f32; COUNT] = file.numbers("std", &json["std"])?;
        let colour = file.number("colour", &json["colour"])?;
        if let Some(value) = deviation.iter().chain([&colour]).find(|&&value| value < 0.0) {
            return Err(
                file.error(value, "a standard deviation and a colour multiplier of 0 or more")
            );
        }
        Ok(Self {
            mean: file.numbers("mean", &json["mean"])?,
            scale: deviation.map(|deviation| 1.0 / (deviation + 1e-6)),
            w1: file.rows("w1", &json["w1"])?,
            b1: file.numbers("b1", &json["b1"])?,
            w2: file.rows("w2", &json["w2"])?,
            b2: file.numbers("b2", &json["b2"])?,
            colour,
        })
    }

    /// Multiplier `λ_c` of the colour distance that the weights were trained with.
    pub fn colour(&self) -> f32 {
        self.colour
    }
}

/// The file that is read, for its errors.
struct File<'a> {
    path: &'a Path,
}

impl File<'_> {
    fn error(&self, found: impl ToString, expected: impl ToString) -> Error {
        let (found, expected) = (found.to_string(), expected.to_string());
        Error::Format { path: self.path.into(), found, expected }
    }

    fn number(&self, name: &str, value: &Value) -> Result<f32, Error> {
        let number = value.as_f64().map(|number| number as f32).filter(|number| number.is_finite());
        number.ok_or_else(|| self.error(format!("{name} = {value}"), "a finite number"))
    }

    fn array<'a>(&self, name: &str, value: &'a Value, count: usize) -> Result<&'a [Value], Error> {
        let array = value.as_array().filter(|array| array.len() == count);
        array.map(Vec::as_slice).ok_or_else(|| {
            let found =
                value.as_array().map_or("nothing".to_owned(), |array| array.len().to_string());
            self.error(format!("{found} in {name}"), format!("an array of {count}"))
        })
    }

    fn numbers<const N: usize>(&self, name: &str, value: &Value) -> Result<[f32; N], Error> {
        let mut numbers = [0.0; N];
        for (number, value) in numbers.iter_mut().zip(self.array(name, value, N)?) {
            *number = self.number(name, value)?;
        }
        Ok(numbers)
    }

    fn rows<const N: usize, const M: usize>(
        &self,
        name: &str,
        value: &Value,
    ) -> Result<[[f32; M]; N], Error> {
        let mut rows = [[0.0; M]; N];
        for (index, (row, value)) in rows.iter_mut().zip(self.array(name, value, N)?).enumerate() {
            *row = self.numbers(&format!("{name}[{index}]"), value)?;
        }
        Ok(rows)
    }
}

/// The network at all pixels of a row.
pub(super) struct RowOfPixels<'a> {
    pub(super) network: &'a Network,
    /// The 36 features, one row of pixels after the other.
    pub(super) features: &'a mut [f32],
    /// Which of them the picture has.
    pub(super) present: &'a [bool; COUNT],
    /// The six parameters, one row of pixels after the other.
    pub(super) out: &'a mut [f32],
}

impl Kernel for RowOfPixels<'_> {
    type Output = ();

    #[inline(always)]
    fn run(self) {
        let Self { network, features, present, out } = self;
        let width = out.len() / OUTPUTS;
        let scales = network.mean.iter().zip(&network.scale).zip(present);
        for (row, ((mean, scale), &is_present)) in features.chunks_exact_mut(width).zip(scales) {
            for value in row {
                let normalised = ((*value - mean) * scale).clamp(-FARTHEST, FARTHEST);
                *value = if is_present { normalised } else { 0.0 };
            }
        }
        let mut hidden = vec![0.0; HIDDEN * width];
        linear(features, &network.w1, &network.b1, &mut hidden);
        hidden.iter_mut().for_each(|value| *value = sigmoid(*value));
        linear(&hidden, &network.w2, &network.b2, out);
        out.iter_mut().for_each(|value| *value = softplus(value.clamp(ARGUMENT.0, ARGUMENT.1)));
    }
}

/// `W x + b` at all pixels of a row.
#[inline(always)]
fn linear<const N: usize>(inputs: &[f32], weights: &[[f32; N]], biases: &[f32], out: &mut [f32]) {
    let width = inputs.len() / N;
    for ((out, weights), &bias) in out.chunks_exact_mut(width).zip(weights).zip(biases) {
        out.fill(bias);
        for (input, weight) in inputs.chunks_exact(width).zip(weights) {
            out.iter_mut().zip(input).for_each(|(out, input)| *out += weight * input);
        }
    }
}

/// `1 / (1 + e^−x)` without an exponential that overflows.
#[inline(always)]
fn sigmoid(x: f32) -> f32 {
    let small = exp_negative(x.abs());
    (if x >= 0.0 { 1.0 } else { small }) / (1.0 + small)
}

/// `ln(1 + e^x)` without an exponential that overflows.
#[inline(always)]
fn softplus(x: f32) -> f32 {
    x.max(0.0) + exp_negative(x.abs()).ln_1p()
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::simd::vectorise;
    use serde_json::json;

    /// Weights of some size everywhere, all different.
    fn weights() -> Value {
        let numbers = |count: usize, start: f64| -> Vec<f64> {
            (0..count).map(|index| ((start + index as f64) * 1.7).sin()).collect()
        };
        let deviation: Vec<f64> = numbers(COUNT, 9.0).iter().map(|value| value.abs()).collect();
        json!({
            "version": 1,
            "features": names(),
            "mean": numbers(COUNT, 1.0),
            "std": deviation,
            "w1": (0..HIDDEN).map(|row| numbers(COUNT, 100.0 * row as f64)).collect::<Vec<_>>(),
            "b1": numbers(HIDDEN, 5.0),
            "w2": (0..OUTPUTS).map(|row| numbers(HIDDEN, 50.0 * row as f64)).collect::<Vec<_>>(),
            "b2": numbers(OUTPUTS, 7.0),
            "colour": 0.25,
        })
    }

    fn parse(json: &Value) -> Result<Network, Error> {
        Network::parse(&json.to_string(), "weights.json".as_ref())
    }

    #[test]
    fn the_embedded_weights_are_whole() {
        assert!(Network::embedded().colour() > 0.0);
    }

    #[test]
    fn the_network_equals_its_formula() {
        let network = parse(&weights()).unwrap();
        let width = 19;
        let mut present = [true; COUNT];
        (present[3], present[30]) = (false, false);
        let inputs: Vec<f32> =
            (0..COUNT * width).map(|index| (index as f32 * 0.37).sin() * 3.0).collect();
        let mut out = vec![0.0; OUTPUTS * width];
        let features = &mut inputs.clone();
        vectorise(RowOfPixels { network: &network, features, present: &present, out: &mut out });
        for pixel in 0..width {
            let normalised: [f64; COUNT] = std::array::from_fn(|index| {
                let value = f64::from(inputs[index * width + pixel] - network.mean[index]);
                let clamped = (value * f64::from(network.scale[index])).clamp(-10.0, 10.0);
                if present[index] { clamped } else { 0.0 }
            });
            let dot = |weights: &[f32], values: &[f64]| -> f64 {
                weights.iter().zip(values).map(|(&weight, value)| f64::from(weight) * value).sum()
            };
            let hidden: [f64; HIDDEN] = std::array::from_fn(|unit| {
                let x = f64::from(network.b1[unit]) + dot(&network.w1[unit], &normalised);
                1.0 / (1.0 + (-x).exp())
            });
            for output in 0..OUTPUTS {
                let x = f64::from(network.b2[output]) + dot(&network.w2[output], &hidden);
                let expected = (1.0 + x.exp()).ln();
                let found = f64::from(out[output * width + pixel]);
                assert!((found / expected - 1.0).abs() < 3e-5, "{found} instead of {expected}");
            }
        }
    }

    #[test]
    fn the_ends_of_sigmoid_and_softplus_are_finite() {
        assert_eq!(
            [-f32::MAX, -200.0, 0.0, 200.0, f32::MAX].map(sigmoid),
            [0.0, 0.0, 0.5, 1.0, 1.0]
        );
        assert!((softplus(0.0) - std::f32::consts::LN_2).abs() < 1e-7);
        assert!((softplus(ARGUMENT.1) - 10.000_045).abs() < 1e-5);
        // e⁻⁸⁰.
        assert!((softplus(ARGUMENT.0) / 1.804_851_4e-35 - 1.0).abs() < 1e-5);
    }

    #[test]
    fn wrong_weights_are_refused_by_name() {
        assert!(parse(&weights()).is_ok());
        let change = |key: &str, value: Value| {
            let mut json = weights();
            json[key] = value;
            parse(&json).unwrap_err().to_string()
        };
        let mut swapped = names();
        swapped.swap(4, 5);
        for (error, part) in [
            (change("version", json!(2)), "version 2, expected version 1"),
            (change("features", json!(["mad.position"])), "1 features, expected 36"),
            (change("features", json!(swapped)), "\"mean.position\", expected mad.visibility"),
            (change("mean", json!([1.0])), "1 in mean, expected an array of 36"),
            (
                change("w2", json!([[1.0], [1.0], [], [], [], []])),
                "1 in w2[0], expected an array of 10",
            ),
            (change("b2", json!([0, 0, 0, 0, 0, "x"])), "b2 = \"x\", expected a finite number"),
            (change("b2", json!([0, 0, 0, 0, 0, 1e300])), "expected a finite number"),
            (change("std", json!([-1.0; COUNT].as_slice())), "-1, expected a standard deviation"),
            (change("colour", Value::Null), "colour = null"),
            (Network::parse("{", "weights.json".as_ref()).unwrap_err().to_string(), "no JSON"),
        ] {
            assert!(error.contains("weights.json") && error.contains(part), "{error}");
        }
    }
}

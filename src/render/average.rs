//! One picture out of several of the same scene with different seeds, as one longer render would have made it.

use crate::film::sum_to_beauty;
use ndarray::{Array2, Array3, Axis, Zip};
use quietlight_denoise::exr::{Contents, Frame};
use quietlight_denoise::{Image, Layer, LayerKind, Layers};
use std::collections::{BTreeMap, BTreeSet};

/// What the metadata of two pictures must agree in, beside their size.
const SAME: [&str; 5] =
    ["scene_identity", "integrator", "integrator_settings", "strategy", "version"];

/// Numbers of the metadata that add up.
const ADDED: [&str; 3] = ["samples", "invalid_samples", "seconds"];

/// What the metadata of adaptive pictures have, and no others.
pub(super) const ADAPTIVE: &str = "adaptive";

/// Why pictures cannot be put together.
#[derive(Clone, Debug, PartialEq, Eq, thiserror::Error)]
pub enum AverageError {
    /// It does not say what is to be known of it.
    #[error(
        "{name} does not tell its {fact}: it was not written by `quietlight render` of this version"
    )]
    Unknown {
        /// The picture.
        name: String,
        /// What is missing in its metadata.
        fact: &'static str,
    },
    /// Two pictures of the same random numbers are not independent.
    #[error(
        "{name} and {other} have the same seed, {seed}: their noise is the same, and would not average out"
    )]
    SameSeed {
        /// A picture.
        name: String,
        /// Another one.
        other: String,
        /// The seed of both.
        seed: String,
    },
    /// Two pictures show something else.
    #[error("{name} is of another render than {other}: {what} is {found} and not {expected}")]
    Differs {
        /// The picture.
        name: String,
        /// The first one.
        other: String,
        /// What is different.
        what: String,
        /// What it is there.
        found: String,
        /// What it is in the first one.
        expected: String,
    },
}

/// Pictures added up so far. A pixel's mean is weighted by its samples, and so is each half's; the variance of such a mean is
/// `Σ n² v / (Σ n)²` for variances `v` of means of `n` samples.
#[derive(Clone, Debug)]
pub struct Average {
    frame: Frame,
    width: usize,
    height: usize,
    /// Sum of samples, of those of both halves, of each pixel.
    weight: Array2<f64>,
    half_weight: [Array2<f64>; 2],
    layers: BTreeMap<LayerKind, Sums>,
    samples: Option<Image>,
    invalid: Option<Image>,
    metadata: BTreeMap<String, String>,
    /// Name of the first picture, and which picture has which seed.
    first: String,
    seeds: BTreeMap<String, String>,
    sums: BTreeMap<&'static str, f64>,
}

/// Weighted sums of one layer.
#[derive(Clone, Debug)]
struct Sums {
    mean: Array3<f64>,
    variance: Option<Array3<f64>>,
    halves: Option<[Array3<f64>; 2]>,
}

impl Average {
    /// Of one picture, which is called `name` in errors.
    ///
    /// # Errors
    /// [`AverageError::Unknown`].
    pub fn new(name: &str, contents: Contents) -> Result<Self, AverageError> {
        let Contents { layers, frame, .. } = contents;
        let size = (layers.height, layers.width);
        let blank = || Array2::zeros(size);
        let mut average = Self {
            frame,
            width: layers.width,
            height: layers.height,
            weight: blank(),
            half_weight: [blank(), blank()],
            layers: BTreeMap::new(),
            samples: None,
            invalid: None,
            metadata: layers.metadata.clone(),
            first: name.to_owned(),
            seeds: BTreeMap::new(),
            sums: BTreeMap::new(),
        };
        for fact in SAME {
            known(name, &layers, fact)?;
        }
        for (&kind, layer) in &layers.layers {
            let zeros = || Array3::zeros(layer.mean.dim());
            let sums = Sums {
                mean: zeros(),
                variance: layer.variance.as_ref().map(|_| zeros()),
                halves: layer.halves.as_ref().map(|_| [zeros(), zeros()]),
            };
            average.layers.insert(kind, sums);
        }
        average.add_to(name, layers)?;
        Ok(average)
    }

    /// Adds another picture.
    ///
    /// # Errors
    /// Where it is not of the same scene, size and settings, has a seed that is there already, or does not tell.
    pub fn add(&mut self, name: &str, contents: Contents) -> Result<(), AverageError> {
        let Contents { layers, frame, .. } = contents;
        let differs = |what: &str, found: String, expected: String| AverageError::Differs {
            name: name.to_owned(),
            other: self.first.clone(),
            what: what.to_owned(),
            found,
            expected,
        };
        let size = |width: usize, height: usize, frame: &Frame| {
            let ((x, y), (columns, rows)) = (frame.offset, frame.display);
            format!("{width}x{height} at {x},{y} of {columns}x{rows}")
        };
        let (is, expected) =
            (size(layers.width, layers.height, &frame), size(self.width, self.height, &self.frame));
        if is != expected {
            return Err(differs("size", is, expected));
        }
        for fact in SAME {
            let is = known(name, &layers, fact)?;
            if let Some(expected) = self.metadata.get(fact).filter(|&expected| expected != is) {
                return Err(differs(fact, is.to_owned(), expected.clone()));
            }
        }
        let names = |kinds: &mut dyn Iterator<Item = &LayerKind>| {
            kinds.map(|kind| kind.name()).collect::<Vec<_>>().join(", ")
        };
        let (is, expected) = (names(&mut layers.layers.keys()), names(&mut self.layers.keys()));
        if is != expected {
            return Err(differs("list of layers", is, expected));
        }
        self.add_to(name, layers)
    }

    fn add_to(&mut self, name: &str, layers: Layers) -> Result<(), AverageError> {
        let seed = known(name, &layers, "seed")?;
        for seed in seed.split(',').map(str::trim) {
            if let Some(other) = self.seeds.insert(seed.to_owned(), name.to_owned()) {
                let (name, seed) = (name.to_owned(), seed.to_owned());
                return Err(AverageError::SameSeed { name, other, seed });
            }
        }
        for fact in ADDED {
            let number: Result<f64, _> = known(name, &layers, fact)?.parse();
            let unknown = |_| AverageError::Unknown { name: name.to_owned(), fact };
            *self.sums.entry(fact).or_default() += number.map_err(unknown)?;
        }
        let of_one =
            [&self.metadata, &layers.metadata].iter().find_map(|known| known.get(ADAPTIVE));
        let adaptive = of_one.cloned();
        self.metadata.retain(|fact, value| layers.metadata.get(fact) == Some(value));
        self.metadata.extend(adaptive.map(|spread| (ADAPTIVE.to_owned(), spread)));

        let weight = weights(name, &layers)?;
        // The first half has the samples of even index.
        let of_half = [weight.mapv(|n| (0.5 * n).ceil()), weight.mapv(|n| (0.5 * n).floor())];
        // One sample has no variance, and no halves.
        let is_single = weight.iter().any(|&n| n < 2.0);
        for (kind, layer) in &layers.layers {
            let Some(sums) = self.layers.get_mut(kind) else { continue };
            add_weighted(&mut sums.mean, &layer.mean, &weight, |n| n);
            sums.variance =
                sums.variance.take().zip(layer.variance.as_ref()).map(|(mut sum, variance)| {
                    add_weighted(&mut sum, variance, &weight, |n| n * n);
                    sum
                });
            sums.halves =
                sums.halves.take().zip(layer.halves.as_ref()).map(|(mut sums, halves)| {
                    for ((sum, half), weight) in sums.iter_mut().zip(halves).zip(&of_half) {
                        add_weighted(sum, half, weight, |n| n);
                    }
                    sums
                });
            if is_single {
                (sums.variance, sums.halves) = (None, None);
            }
        }
        self.weight += &weight;
        for (sum, more) in self.half_weight.iter_mut().zip(&of_half) {
            *sum += more;
        }
        add_counts(&mut self.samples, layers.samples);
        add_counts(&mut self.invalid, layers.invalid);
        Ok(())
    }

    /// The average, and where its pixels lie in the whole picture. Its metadata are those that all pictures agree in, with
    /// all seeds and the sums of samples and seconds; what was said of a denoiser is left out.
    pub fn finish(self) -> (Layers, Frame) {
        let mut layers = Layers { width: self.width, height: self.height, ..Layers::default() };
        for (kind, sums) in self.layers {
            let over = |sum: Array3<f64>, weight: &Array2<f64>, power: i32| {
                let mut image = Array3::zeros(sum.dim());
                for (mut out, sum) in image.axis_iter_mut(Axis(0)).zip(sum.axis_iter(Axis(0))) {
                    Zip::from(&mut out).and(&sum).and(weight).for_each(|out, &sum, &n| {
                        *out = if n > 0.0 { (sum / n.powi(power)) as f32 } else { 0.0 };
                    });
                }
                image
            };
            let layer = Layer {
                mean: over(sums.mean, &self.weight, 1),
                variance: sums.variance.map(|variance| over(variance, &self.weight, 2)),
                halves: sums.halves.map(|[a, b]| {
                    [over(a, &self.half_weight[0], 1), over(b, &self.half_weight[1], 1)]
                }),
            };
            layers.layers.insert(kind, layer);
        }
        sum_to_beauty(&mut layers);
        (layers.samples, layers.invalid) = (self.samples, self.invalid);
        layers.metadata = self.metadata;
        layers.metadata.retain(|fact, _| !fact.starts_with("denoiser"));
        let seeds: BTreeSet<(usize, &String)> =
            self.seeds.keys().map(|seed| (seed.len(), seed)).collect();
        let seeds: Vec<&str> = seeds.into_iter().map(|(_, seed)| seed.as_str()).collect();
        layers.metadata.insert("seed".to_owned(), seeds.join(", "));
        for (fact, sum) in self.sums {
            let value = if fact == "seconds" { format!("{sum:.3}") } else { format!("{sum:.0}") };
            layers.metadata.insert(fact.to_owned(), value);
        }
        (layers, self.frame)
    }
}

fn known<'a>(name: &str, layers: &'a Layers, fact: &'static str) -> Result<&'a str, AverageError> {
    let value = layers.metadata.get(fact).map(String::as_str);
    value.ok_or_else(|| AverageError::Unknown { name: name.to_owned(), fact })
}

/// Samples of each pixel: those counted where every sample belongs to a pixel, else mutations per pixel. Where the counts of an
/// adaptive picture tell of what was found, weights by them would not be independent of it: there they are the mean.
fn weights(name: &str, layers: &Layers) -> Result<Array2<f64>, AverageError> {
    let is_even = !layers.metadata.contains_key(ADAPTIVE);
    if let (true, Some("path"), Some(samples)) =
        (is_even, layers.metadata.get("integrator").map(String::as_str), &layers.samples)
    {
        return Ok(samples.index_axis(Axis(0), 0).mapv(f64::from));
    }
    let unknown = || AverageError::Unknown { name: name.to_owned(), fact: "samples" };
    let samples = known(name, layers, "samples")?.parse().map_err(|_| unknown())?;
    Ok(Array2::from_elem((layers.height, layers.width), samples))
}

/// Adds an image, each pixel times what `factor` makes of its weight.
fn add_weighted(
    sum: &mut Array3<f64>,
    image: &Image,
    weight: &Array2<f64>,
    factor: impl Fn(f64) -> f64,
) {
    for (mut sum, image) in sum.axis_iter_mut(Axis(0)).zip(image.axis_iter(Axis(0))) {
        Zip::from(&mut sum).and(&image).and(weight).for_each(|sum, &value, &n| {
            *sum += factor(n) * f64::from(value);
        });
    }
}

/// Adds counts, where both have them.
fn add_counts(sum: &mut Option<Image>, more: Option<Image>) {
    *sum = match (sum.take(), more) {
        (Some(sum), Some(more)) => Some(sum + more),
        (sum, more) => sum.or(more),
    };
}

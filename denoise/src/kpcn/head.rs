//! The layer that gives the logits of the finest level: a 1×1 convolution of the network's last features.
//!
//! In onnxruntime its 140 channels at half the resolution took half of all memory, for numbers that are needed once. Here
//! they exist for one row of pixels at a time, between the features and the softmax that they are for.

use super::pyramid::{DOWN, FINEST_OUTPUTS};
use super::softmax::{BLOCK, Row, each};
use crate::simd::{Kernel, vectorise};

/// Logits of a pixel: of its taps, and of its weight on the way down.
const LOGITS: usize = DOWN + 1;

/// Logits computed side by side, in as many registers of AVX-512 or twice as many of AVX2. With fewer each feature would
/// be fetched more often and an addition would wait for the one before.
const GROUP: usize = 7;

const _: () = assert!(LOGITS.is_multiple_of(GROUP));

/// Weights and biases, packed in the order of their use. Pixels of a 2×2 cell are numbered `2 dy + dx`.
#[derive(Debug)]
pub(super) struct Head {
    /// Features that it is given.
    pub(super) inputs: usize,
    /// All logits of each pixel of the cell. (The last one, which is not a tap's, is computed for nothing: 34 logits have
    /// no such groups.)
    taps: [Vec<Group>; 4],
    /// The logit of the way down of the four pixels; the rest of the group is 0.
    down: Group,
}

/// Some outputs.
#[derive(Debug)]
struct Group {
    /// By input.
    weights: Vec<[f32; GROUP]>,
    bias: [f32; GROUP],
}

impl Head {
    /// Of `weight`, `[140, inputs]`, and `bias`, `[140]`, whose outputs are logit `c` of pixel `k` of the cell at `4 c + k`.
    pub(super) fn new(weight: &[f32], bias: &[f32]) -> Self {
        let inputs = weight.len() / FINEST_OUTPUTS;
        let group = |outputs: &[usize]| {
            let mut group = Group { weights: vec![[0.0; GROUP]; inputs], bias: [0.0; GROUP] };
            for (index, &output) in outputs.iter().enumerate() {
                group.bias[index] = bias[output];
                let weight = &weight[output * inputs..][..inputs];
                group.weights.iter_mut().zip(weight).for_each(|(all, one)| all[index] = *one);
            }
            group
        };
        let logits = |pixel| (0..LOGITS).map(|logit| 4 * logit + pixel).collect::<Vec<_>>();
        Self {
            inputs,
            taps: [0, 1, 2, 3].map(|pixel| logits(pixel).chunks(GROUP).map(group).collect()),
            down: group(&[0, 1, 2, 3].map(|pixel| 4 * DOWN + pixel)),
        }
    }

    /// All logits of pixel `pixel` of the cells of a row, `[logits, stride]` of [`Features::stride`].
    pub(super) fn logits<'a>(
        &self,
        features: &Features,
        pixel: usize,
        out: &'a mut Vec<f32>,
    ) -> &'a [f32] {
        out.resize(LOGITS * features.stride(), 0.0);
        vectorise(Convolve { features, groups: &self.taps[pixel], out });
        out
    }

    /// The logits of the way down of the cells of a row, `[4, stride]` of [`Features::stride`].
    pub(super) fn down(&self, features: &Features, out: &mut [f32]) {
        vectorise(Convolve { features, groups: std::slice::from_ref(&self.down), out });
    }
}

/// Features of a row of cells: all of a block of cells, then of the next. In the network's output those of one cell lie so
/// far apart, by powers of two moreover, that a cache cannot hold many.
#[derive(Debug, Default)]
pub(super) struct Features {
    blocks: Vec<Row>,
    inputs: usize,
}

impl Features {
    /// Takes the rows of `inputs` features.
    pub(super) fn take<'a>(&mut self, inputs: usize, rows: impl Iterator<Item = &'a [f32]>) {
        self.inputs = inputs;
        for (input, row) in rows.enumerate() {
            self.blocks.resize(row.len().div_ceil(BLOCK) * inputs, [0.0; BLOCK]);
            let blocks = self.blocks[input..].iter_mut().step_by(inputs);
            for (block, values) in blocks.zip(row.chunks(BLOCK)) {
                block[..values.len()].copy_from_slice(values);
            }
        }
    }

    /// Cells of the row, rounded up to whole blocks.
    pub(super) fn stride(&self) -> usize {
        self.blocks.len() / self.inputs * BLOCK
    }
}

/// The convolution.
struct Convolve<'a> {
    features: &'a Features,
    groups: &'a [Group],
    /// `[outputs, stride]`.
    out: &'a mut [f32],
}

impl Kernel for Convolve<'_> {
    type Output = ();

    #[inline(always)]
    fn run(self) {
        let Self { features, groups, out } = self;
        let stride = features.stride();
        for (block, features) in features.blocks.chunks_exact(features.inputs).enumerate() {
            for (group, out) in groups.iter().zip(out.chunks_mut(GROUP * stride)) {
                let sums = group.of(features);
                for (sum, out) in sums.iter().zip(out.chunks_exact_mut(stride)) {
                    out[block * BLOCK..][..BLOCK].copy_from_slice(sum);
                }
            }
        }
    }
}

impl Group {
    /// The outputs of a block of cells.
    #[inline(always)]
    fn of(&self, features: &[Row]) -> [Row; GROUP] {
        // One by one: LLVM makes vectors of a loop over the sums, not of the pixels, and gathers them from memory.
        let [mut a, mut b, mut c, mut d, mut e, mut f, mut g] = self.bias.map(|bias| [bias; BLOCK]);
        for (weights, feature) in self.weights.iter().zip(features) {
            let add = |sum, weight| each(sum, *feature, |sum, feature| sum + weight * feature);
            a = add(a, weights[0]);
            b = add(b, weights[1]);
            c = add(c, weights[2]);
            d = add(d, weights[3]);
            e = add(e, weights[4]);
            f = add(f, weights[5]);
            g = add(g, weights[6]);
        }
        [a, b, c, d, e, f, g]
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Any numbers in `±1`.
    fn numbers(count: usize, seed: usize) -> Vec<f32> {
        (0..count).map(|index| ((index * 7919 + seed) % 2003) as f32 / 1001.0 - 1.0).collect()
    }

    fn features(inputs: usize, width: usize) -> (Vec<f32>, Features) {
        let values = numbers(inputs * width, 5);
        let mut features = Features::default();
        // What an earlier, longer row leaves must not stay.
        features.take(inputs, numbers(inputs * 3 * width, 9).chunks(3 * width));
        features.take(inputs, values.chunks(width));
        (values, features)
    }

    #[test]
    fn the_logits_are_those_of_a_convolution() {
        for (inputs, width) in [(1, 1), (5, 16), (12, 37)] {
            let (weight, bias) = (numbers(FINEST_OUTPUTS * inputs, 1), numbers(FINEST_OUTPUTS, 2));
            let head = Head::new(&weight, &bias);
            let (values, features) = features(inputs, width);
            let stride = features.stride();
            assert_eq!(stride, width.next_multiple_of(BLOCK));
            let exact = |output: usize, x: usize| {
                let products = (0..inputs).map(|input| {
                    f64::from(weight[output * inputs + input])
                        * f64::from(values[input * width + x])
                });
                f64::from(bias[output]) + products.sum::<f64>()
            };
            let mut down = vec![0.0; 4 * stride];
            head.down(&features, &mut down);
            let mut logits = Vec::new();
            for pixel in 0..4 {
                let logits = head.logits(&features, pixel, &mut logits);
                for (x, logit) in (0..width).flat_map(|x| (0..LOGITS).map(move |c| (x, c))) {
                    let (found, exact) = (logits[logit * stride + x], exact(4 * logit + pixel, x));
                    assert!((f64::from(found) - exact).abs() < 1e-5, "{found} {exact}");
                }
                let last = &logits[DOWN * stride..][..width];
                assert_eq!(&down[pixel * stride..][..width], last, "the way down");
            }
        }
    }

    #[test]
    fn every_processor_gives_the_same_bits() {
        let inputs = 29;
        let head = Head::new(&numbers(FINEST_OUTPUTS * inputs, 3), &numbers(FINEST_OUTPUTS, 4));
        let (_, features) = features(inputs, 50);
        let mut vectors = Vec::new();
        head.logits(&features, 3, &mut vectors);
        let mut plain = vec![0.0; vectors.len()];
        Convolve { features: &features, groups: &head.taps[3], out: &mut plain }.run();
        assert_eq!(vectors, plain);
    }
}

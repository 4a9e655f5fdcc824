//! Convolutions with their gradients with respect to the input, and max pooling.
//!
//! Channels are innermost, so the inputs under a row of a kernel are contiguous: an output is a sum of dot
//! products with such runs, without copies of patches. Eight outputs of four pixels are summed at a time,
//! which fit in vector registers. Each sum has a fixed order.

use rayon::prelude::*;

use crate::raster::Real;

/// Outputs and pixels that are summed at a time.
const LANES: usize = 8;
const PIXELS: usize = 4;

/// Pixels per parallel task, for one block of outputs.
const CHUNK: usize = 16 * PIXELS;

/// Features with any number of channels: `[y][x][channel]`.
#[derive(Clone, Debug, PartialEq)]
pub(super) struct FeatureMap<T> {
    /// Rows and columns.
    pub(super) size: [usize; 2],
    pub(super) channels: usize,
    pub(super) values: Vec<T>,
}

/// Weights of a correlation, in the order of their use.
struct Kernel<T> {
    /// Rows and columns.
    size: [usize; 2],
    inputs: usize,
    outputs: usize,
    /// `[block of outputs][row][column][input]`, the last block padded with zeros.
    weights: Vec<[T; LANES]>,
}

impl<T: Real> Kernel<T> {
    /// `weight` maps `[output, input, row, column]` to a weight.
    fn new(size: [usize; 2], inputs: usize, outputs: usize, weight: impl Fn([usize; 4]) -> T) -> Kernel<T> {
        let mut weights = Vec::with_capacity(outputs.div_ceil(LANES) * size[0] * size[1] * inputs);
        for block in (0..outputs).step_by(LANES) {
            for row in 0..size[0] {
                for column in 0..size[1] {
                    for input in 0..inputs {
                        weights.push(std::array::from_fn(|lane| match block + lane {
                            output if output < outputs => weight([output, input, row, column]),
                            _ => T::zero(),
                        }));
                    }
                }
            }
        }
        Kernel { size, inputs, outputs, weights }
    }

    /// Correlates `input`, with zeros beyond its edges. The window of the first output pixel begins at row
    /// and column `origin`; neighbouring windows are `stride` apart.
    fn correlate(
        &self,
        input: &FeatureMap<T>,
        origin: [isize; 2],
        stride: usize,
        size: [usize; 2],
    ) -> FeatureMap<T> {
        let extent = [0, 1].map(|axis| size[axis].saturating_sub(1) * stride + self.size[axis]);
        let padded = window(input, origin, extent);
        let row_length = extent[1] * self.inputs;
        let taps = self.size[1] * self.inputs;
        let count = size[0] * size[1];
        let begin =
            |pixel: usize| (pixel / size[1] * stride) * row_length + (pixel % size[1]) * stride * self.inputs;
        // The sums of a block of outputs are contiguous, so that its weights stay in the cache.
        let chunks = count.div_ceil(CHUNK);
        let blocks = self.outputs.div_ceil(LANES);
        let mut sums = vec![[T::zero(); LANES]; blocks * chunks * CHUNK];
        sums.par_chunks_mut(CHUNK).enumerate().for_each(|(i, sums)| {
            let weights = &self.weights[i / chunks * self.size[0] * taps..][..self.size[0] * taps];
            for (group, sums) in sums.as_chunks_mut::<PIXELS>().0.iter_mut().enumerate() {
                let first = i % chunks * CHUNK + group * PIXELS;
                if first < count {
                    // Past the last pixel, repeats it.
                    let begins: [usize; PIXELS] = std::array::from_fn(|i| begin((first + i).min(count - 1)));
                    let mut of_group = [[T::zero(); LANES]; PIXELS];
                    for (row, weights) in weights.chunks(taps).enumerate() {
                        let runs = begins.map(|begin| &padded[begin + row * row_length..][..taps]);
                        accumulate(&mut of_group, runs, weights);
                    }
                    *sums = of_group;
                }
            }
        });
        let mut values = vec![T::zero(); count * self.outputs];
        values.par_chunks_mut(self.outputs).enumerate().for_each(|(pixel, values)| {
            for (block, values) in values.chunks_mut(LANES).enumerate() {
                values.copy_from_slice(&sums[block * chunks * CHUNK + pixel][..values.len()]);
            }
        });
        FeatureMap { size, channels: self.outputs, values }
    }
}

/// `sums[pixel][lane] += sum over i of runs[pixel][i] * weights[i][lane]`.
#[inline(always)]
fn accumulate<T: Real>(sums: &mut [[T; LANES]; PIXELS], runs: [&[T]; PIXELS], weights: &[[T; LANES]]) {
    let mut local = *sums;
    let [a, b, c, d] = runs;
    for ((((weights, a), b), c), d) in weights.iter().zip(a).zip(b).zip(c).zip(d) {
        for (sums, x) in local.iter_mut().zip([*a, *b, *c, *d]) {
            for (sum, weight) in sums.iter_mut().zip(weights) {
                *sum += x * *weight;
            }
        }
    }
    *sums = local;
}

/// The part of `input` that begins at `origin`, with zeros beyond the edges.
fn window<T: Real>(input: &FeatureMap<T>, origin: [isize; 2], size: [usize; 2]) -> Vec<T> {
    let mut values = vec![T::zero(); size[0] * size[1] * input.channels];
    let inside = |axis: usize| {
        let begin = origin[axis].max(0);
        begin..(origin[axis] + size[axis] as isize).min(input.size[axis] as isize).max(begin)
    };
    let columns = inside(1);
    let length = columns.len() * input.channels;
    for y in inside(0) {
        let from = (y as usize * input.size[1] + columns.start as usize) * input.channels;
        let to = (y - origin[0]) as usize * size[1] + (columns.start - origin[1]) as usize;
        if length > 0 {
            values[to * input.channels..][..length].copy_from_slice(&input.values[from..][..length]);
        }
    }
    values
}

/// A convolution with a bias, followed by a rectifier.
pub(super) struct Convolution<T> {
    kernel: Kernel<T>,
    bias: Vec<T>,
    stride: usize,
    padding: usize,
    /// Kernels of the gradient, one per remainder modulo the stride: `[row, column]` remainders of the
    /// inputs, counted from the first window, and their kernel from outputs to inputs.
    back: Vec<([usize; 2], Kernel<T>)>,
}

impl<T: Real> Convolution<T> {
    /// `weights[output][input][row][column]`, flattened, of a square kernel of `side` rows, at least
    /// `stride`.
    pub(super) fn new(
        weights: &[T],
        bias: Vec<T>,
        side: usize,
        stride: usize,
        padding: usize,
    ) -> Convolution<T> {
        let outputs = bias.len();
        let inputs = weights.len() / (outputs * side * side);
        let weight = |[output, input, row, column]: [usize; 4]| {
            weights[((output * inputs + input) * side + row) * side + column]
        };
        let rests = (0..stride).flat_map(|row| (0..stride).map(move |column| [row, column]));
        let back = rests.map(|rest| {
            let size = rest.map(|rest| (side - rest).div_ceil(stride));
            let mirrored = |[input, output, row, column]: [usize; 4]| {
                let at = |axis: usize, i: usize| rest[axis] + stride * (size[axis] - 1 - i);
                weight([output, input, at(0, row), at(1, column)])
            };
            (rest, Kernel::new(size, outputs, inputs, mirrored))
        });
        let back = back.collect();
        let kernel = Kernel::new([side; 2], inputs, outputs, weight);
        Convolution { kernel, bias, stride, padding, back }
    }

    /// Number of output channels.
    pub(super) fn outputs(&self) -> usize {
        self.bias.len()
    }

    /// Size of the output for an input of `size`; `None` if no window fits.
    pub(super) fn output_size(&self, size: [usize; 2]) -> Option<[usize; 2]> {
        windows(size.map(|side| side + 2 * self.padding), self.kernel.size[0], self.stride)
    }

    /// The output for an input in which at least one window fits.
    pub(super) fn forward(&self, input: &FeatureMap<T>) -> FeatureMap<T> {
        let size = self.output_size(input.size).unwrap_or_default();
        let mut output = self.kernel.correlate(input, [-(self.padding as isize); 2], self.stride, size);
        for pixel in output.values.chunks_mut(self.outputs()) {
            for (value, bias) in pixel.iter_mut().zip(&self.bias) {
                *value = (*value + *bias).max(T::zero());
            }
        }
        output
    }

    /// The gradient with respect to an input of `size`, given the gradient of its `output`.
    pub(super) fn backward(
        &self,
        output: &FeatureMap<T>,
        mut gradient: FeatureMap<T>,
        size: [usize; 2],
    ) -> FeatureMap<T> {
        for (gradient, output) in gradient.values.iter_mut().zip(&output.values) {
            if *output <= T::zero() {
                *gradient = T::zero();
            }
        }
        let channels = self.kernel.inputs;
        let mut values = vec![T::zero(); size[0] * size[1] * channels];
        for (rest, kernel) in &self.back {
            // The last output whose window covers row `y` is `(y + padding - rest) / stride`; `first` is
            // the first `y` in the image with this remainder.
            let quotient = rest.map(|rest| self.padding.saturating_sub(rest).div_ceil(self.stride));
            let first = [0, 1].map(|axis| quotient[axis] * self.stride + rest[axis] - self.padding);
            let count = [0, 1].map(|axis| size[axis].saturating_sub(first[axis]).div_ceil(self.stride));
            let origin = [0, 1].map(|axis| quotient[axis] as isize - (kernel.size[axis] as isize - 1));
            let part = kernel.correlate(&gradient, origin, 1, count);
            for (i, pixel) in part.values.chunks(channels).enumerate() {
                let y = first[0] + i / count[1] * self.stride;
                let x = first[1] + i % count[1] * self.stride;
                values[(y * size[1] + x) * channels..][..channels].copy_from_slice(pixel);
            }
        }
        FeatureMap { size, channels, values }
    }
}

/// Number of windows of `side` pixels along either axis, `stride` apart; `None` if none fits.
pub(super) fn windows(size: [usize; 2], side: usize, stride: usize) -> Option<[usize; 2]> {
    let along = |length: usize| length.checked_sub(side).map(|room| room / stride + 1);
    Some([along(size[0])?, along(size[1])?])
}

/// Maximum of each window of `side` pixels within the image, and its index among the values of `input`,
/// the first of equals.
pub(super) fn max_pool<T: Real>(
    input: &FeatureMap<T>,
    side: usize,
    stride: usize,
) -> (FeatureMap<T>, Vec<usize>) {
    let size = windows(input.size, side, stride).unwrap_or_default();
    let channels = input.channels;
    let largest = |i: usize| {
        let (pixel, channel) = (i / channels, i % channels);
        let (top, left) = (pixel / size[1] * stride, pixel % size[1] * stride);
        let at = |k: usize| ((top + k / side) * input.size[1] + left + k % side) * channels + channel;
        (1..side * side)
            .map(at)
            .fold(at(0), |best, i| if input.values[i] > input.values[best] { i } else { best })
    };
    let from: Vec<usize> = (0..size[0] * size[1] * channels).into_par_iter().map(largest).collect();
    let values = from.iter().map(|i| input.values[*i]).collect();
    (FeatureMap { size, channels, values }, from)
}

#[cfg(test)]
mod tests {
    use super::*;

    fn map(size: [usize; 2], channels: usize, seed: f64) -> FeatureMap<f64> {
        let values = (0..size[0] * size[1] * channels).map(|i| (1.3 * i as f64 + seed).sin()).collect();
        FeatureMap { size, channels, values }
    }

    /// The definition of a convolution.
    fn direct(
        input: &FeatureMap<f64>,
        weights: &[f64],
        bias: &[f64],
        [side, stride, padding]: [usize; 3],
    ) -> FeatureMap<f64> {
        let size = input.size.map(|length| (length + 2 * padding - side) / stride + 1);
        let mut values = Vec::new();
        for y in 0..size[0] {
            for x in 0..size[1] {
                for (output, bias) in bias.iter().enumerate() {
                    let mut sum = *bias;
                    for k in 0..side * side {
                        let (v, u) = (y * stride + k / side, x * stride + k % side);
                        let inside = v >= padding && u >= padding;
                        if inside && v - padding < input.size[0] && u - padding < input.size[1] {
                            for input_channel in 0..input.channels {
                                let at = ((v - padding) * input.size[1] + u - padding) * input.channels;
                                let weight = (output * input.channels + input_channel) * side * side + k;
                                sum += input.values[at + input_channel] * weights[weight];
                            }
                        }
                    }
                    values.push(sum.max(0.0));
                }
            }
        }
        FeatureMap { size, channels: bias.len(), values }
    }

    /// Kernels of AlexNet and VGG, on images whose sizes are no multiples of their strides.
    const CASES: [([usize; 3], [usize; 2]); 4] =
        [([11, 4, 2], [19, 26]), ([5, 1, 2], [6, 5]), ([3, 1, 1], [1, 3]), ([3, 1, 1], [7, 9])];

    fn convolution(shape: [usize; 3], channels: [usize; 2]) -> (Convolution<f64>, Vec<f64>, Vec<f64>) {
        let [side, stride, padding] = shape;
        let weights = map([side, side], channels[0] * channels[1], 0.7).values;
        let bias = map([1, 1], channels[1], 2.0).values;
        (Convolution::new(&weights, bias.clone(), side, stride, padding), weights, bias)
    }

    #[test]
    fn outputs_match_the_definition() {
        for (shape, size) in CASES {
            for channels in [[3, 8], [2, 11]] {
                let (convolution, weights, bias) = convolution(shape, channels);
                let input = map(size, channels[0], 0.1);
                let (found, expected) = (convolution.forward(&input), direct(&input, &weights, &bias, shape));
                assert_eq!(found.size, expected.size);
                for (a, b) in found.values.iter().zip(&expected.values) {
                    assert!((a - b).abs() < 1e-12, "{shape:?}: {a} {b}");
                }
            }
        }
    }

    /// The output is piecewise linear in the input, so central differences are exact.
    #[test]
    fn gradients_match_finite_differences() {
        for (shape, size) in CASES {
            let (convolution, ..) = convolution(shape, [3, 10]);
            let input = map(size, 3, 0.1);
            let output = convolution.forward(&input);
            let d_output = map(output.size, output.channels, 5.0);
            let gradient = convolution.backward(&output, d_output.clone(), size);
            let value = |input: &FeatureMap<f64>| {
                let output = convolution.forward(input);
                output.values.iter().zip(&d_output.values).map(|(a, b)| a * b).sum::<f64>()
            };
            for i in 0..input.values.len() {
                let moved = |by: f64| {
                    let mut moved = input.clone();
                    moved.values[i] += by;
                    value(&moved)
                };
                let expected = (moved(1e-6) - moved(-1e-6)) / 2e-6;
                let found = gradient.values[i];
                assert!((found - expected).abs() < 1e-6, "{shape:?} {i}: {found} {expected}");
            }
        }
    }

    #[test]
    fn pooling_takes_the_maximum() {
        let input = FeatureMap {
            size: [3, 5],
            channels: 1,
            values: (0..15).map(|i| f64::from(i * 7 % 15)).collect(),
        };
        // 0 7 14 6 13 / 5 12 4 11 3 / 10 2 9 1 8
        let (pooled, from) = max_pool(&input, 3, 2);
        assert_eq!((pooled.size, pooled.values), ([1, 2], vec![14.0, 14.0]));
        assert_eq!(from, [2, 2]);
        let (pooled, _) = max_pool(&input, 2, 2);
        assert_eq!((pooled.size, pooled.values), ([1, 2], vec![12.0, 14.0]));
    }
}

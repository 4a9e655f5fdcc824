//! [`Lpips`]: learned perceptual image patch similarity (Zhang et al., "The unreasonable
//! effectiveness of deep features as a perceptual metric", 2018), and its gradient.
//!
//! Both images pass through a trained network. At five of its layers, the features of each pixel are
//! normalised; their squared differences are weighted by channel, averaged over the pixels, and summed
//! over the layers. The user provides the weights: `features.N.weight` and `features.N.bias` of
//! torchvision, and `lin0.model.1.weight` to `lin4.model.1.weight` of the `lpips` package, version 0.1.

use std::collections::BTreeMap;

use rayon::prelude::*;

use super::LpipsError;
use super::convolution::{FeatureMap, max_pool, windows};
use super::network::{self, Block, LpipsNetwork, WeightTensor};
use crate::raster::Real;

/// Normalisation of the input: channels in `[-1, 1]`, minus `SHIFT`, divided by `SCALE`.
const SHIFT: [f64; 3] = [-0.030, -0.088, -0.188];
const SCALE: [f64; 3] = [0.458, 0.448, 0.450];

/// Added to the norm of a feature before division.
const EPSILON: f64 = 1e-10;

/// A network that measures the perceptual distance of two images.
pub struct Lpips<T> {
    pub(super) network: LpipsNetwork,
    pub(super) blocks: Vec<Block<T>>,
}

/// Intermediate results of a block.
struct Activations<T> {
    /// Size of the pool's input, and the index there of each pooled value.
    pool: Option<([usize; 2], Vec<usize>)>,
    /// Size of the first convolution's input.
    size: [usize; 2],
    /// Outputs of the convolutions.
    outputs: Vec<FeatureMap<T>>,
}

impl<T: Real> Lpips<T> {
    /// AlexNet or VGG16 with these weights, by the names that torchvision and the `lpips` package give them.
    /// Other tensors are ignored.
    ///
    /// # Errors
    /// If a tensor is missing, has another shape, or holds a number that is not finite.
    pub fn new(weights: &BTreeMap<String, WeightTensor>) -> Result<Lpips<T>, LpipsError> {
        let (network, blocks) = network::build(weights)?;
        Ok(Lpips { network, blocks })
    }

    /// The network. Distances by different networks are not comparable.
    pub fn network(&self) -> LpipsNetwork {
        self.network
    }

    /// Checks that images are large enough for each layer to have a pixel.
    ///
    /// # Errors
    /// [`LpipsError::TooSmall`] if they are not.
    pub fn check_size(&self, width: usize, height: usize) -> Result<(), LpipsError> {
        if self.passes([height, width]) {
            return Ok(());
        }
        let smallest = (1..).find(|&side| self.passes([side; 2])).unwrap_or_default();
        Err(LpipsError::TooSmall { size: [width, height], smallest })
    }

    fn passes(&self, size: [usize; 2]) -> bool {
        let through = |size: [usize; 2], block: &Block<T>| {
            let size = block.pool.map_or(Some(size), |[side, stride]| windows(size, side, stride))?;
            block.convolutions.iter().try_fold(size, |size, convolution| convolution.output_size(size))
        };
        self.blocks.iter().try_fold(size, through).is_some()
    }

    /// Distance of two images with rows of `width` pixels: 0 for equal images, rarely above 1. Colours
    /// are in `[0, 1]`, over black; alpha is ignored.
    ///
    /// # Panics
    /// If their sizes differ, or [`Self::check_size`] refuses them.
    pub fn distance(&self, a: &[[T; 4]], b: &[[T; 4]], width: usize) -> f64 {
        self.check_pair(a, b, width);
        let (a, b) = (self.pass(a, width), self.pass(b, width));
        let pairs = self.blocks.iter().zip(a.iter().zip(&b));
        pairs.map(|(block, (a, b))| compare(a.features(), b.features(), &block.head).0).sum()
    }

    /// [`Self::distance`], and its gradient with respect to the colours of the first image.
    ///
    /// # Panics
    /// As [`Self::distance`] does.
    pub fn distance_and_gradient(&self, a: &[[T; 4]], b: &[[T; 4]], width: usize) -> (f64, Vec<[T; 3]>) {
        self.check_pair(a, b, width);
        let (a, b) = (self.pass(a, width), self.pass(b, width));
        let mut distance = 0.0;
        // The gradient of the next block's input.
        let mut from_above: Option<FeatureMap<T>> = None;
        for (block, (a, b)) in self.blocks.iter().zip(a.iter().zip(&b)).rev() {
            let (value, mut gradient) = compare(a.features(), b.features(), &block.head);
            distance += value;
            for (sum, above) in gradient.values.iter_mut().zip(from_above.iter().flat_map(|map| &map.values))
            {
                *sum += *above;
            }
            for (i, convolution) in block.convolutions.iter().enumerate().rev() {
                let size = if i == 0 { a.size } else { a.outputs[i - 1].size };
                gradient = convolution.backward(&a.outputs[i], gradient, size);
            }
            if let Some((size, from)) = &a.pool {
                let mut values = vec![T::zero(); size[0] * size[1] * gradient.channels];
                for (i, g) in from.iter().zip(&gradient.values) {
                    values[*i] += *g;
                }
                gradient = FeatureMap { size: *size, channels: gradient.channels, values };
            }
            from_above = Some(gradient);
        }
        let by_input = from_above.map_or_else(Vec::new, |map| map.values);
        let scaled = |g: &[T; 3]| std::array::from_fn(|c| g[c] * T::from_f64(2.0 / SCALE[c]));
        (distance, by_input.as_chunks().0.iter().map(scaled).collect())
    }

    fn check_pair(&self, a: &[[T; 4]], b: &[[T; 4]], width: usize) {
        assert!(a.len() == b.len() && a.len().is_multiple_of(width.max(1)), "images of one size");
        if let Err(error) = self.check_size(width, a.len() / width.max(1)) {
            panic!("{error}");
        }
    }

    /// The forward pass.
    fn pass(&self, image: &[[T; 4]], width: usize) -> Vec<Activations<T>> {
        let scaled = |pixel: &[T; 4]| -> [T; 3] {
            std::array::from_fn(|c| {
                (pixel[c] * T::from_f64(2.0) - T::from_f64(1.0 + SHIFT[c])) * T::from_f64(1.0 / SCALE[c])
            })
        };
        let values = image.iter().flat_map(scaled).collect();
        let mut input = FeatureMap { size: [image.len() / width, width], channels: 3, values };
        let mut activations: Vec<Activations<T>> = Vec::with_capacity(self.blocks.len());
        for block in &self.blocks {
            let pool = block.pool.map(|[side, stride]| {
                let before = input.size;
                let (pooled, from) = max_pool(&input, side, stride);
                input = pooled;
                (before, from)
            });
            let size = input.size;
            let mut outputs: Vec<FeatureMap<T>> = Vec::with_capacity(block.convolutions.len());
            for convolution in &block.convolutions {
                outputs.push(convolution.forward(outputs.last().unwrap_or(&input)));
            }
            input = outputs.last().unwrap_or(&input).clone();
            activations.push(Activations { pool, size, outputs });
        }
        activations
    }
}

impl<T> Activations<T> {
    fn features(&self) -> &FeatureMap<T> {
        self.outputs.last().expect("a block has a convolution")
    }
}

/// Mean over the pixels of the weighted squared differences of the normalised features, and its gradient
/// with respect to the first.
fn compare<T: Real>(a: &FeatureMap<T>, b: &FeatureMap<T>, head: &[T]) -> (f64, FeatureMap<T>) {
    let channels = a.channels;
    let mut values = vec![T::zero(); a.values.len()];
    let share = T::from_f64(1.0 / (a.size[0] * a.size[1]) as f64);
    let epsilon = T::from_f64(EPSILON);
    let pixels = values.par_chunks_mut(channels).zip(a.values.par_chunks(channels));
    let sums = pixels.zip(b.values.par_chunks(channels)).map(|((gradient, a), b)| {
        let length = |x: &[T]| x.iter().fold(T::zero(), |sum, x| sum + *x * *x).sqrt();
        let (length_a, length_b) = (length(a), length(b));
        let (to_a, to_b) = (T::one() / (length_a + epsilon), T::one() / (length_b + epsilon));
        let (mut sum, mut along) = (T::zero(), T::zero());
        for (((gradient, a), b), weight) in gradient.iter_mut().zip(a).zip(b).zip(head) {
            let difference = *a * to_a - *b * to_b;
            sum += *weight * difference * difference;
            *gradient = T::from_f64(2.0) * share * *weight * difference;
            along += *gradient * *a;
        }
        // Features of norm 0 are rectified, so no gradient passes.
        let along = if length_a > T::zero() { along * to_a * to_a / length_a } else { T::zero() };
        for (gradient, a) in gradient.iter_mut().zip(a) {
            *gradient = *gradient * to_a - along * *a;
        }
        (sum * share).to_double()
    });
    let sums: Vec<f64> = sums.collect();
    (sums.iter().sum(), FeatureMap { size: a.size, channels, values })
}

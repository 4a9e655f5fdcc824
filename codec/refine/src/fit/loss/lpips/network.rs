//! The networks of LPIPS: their layers and weights.

use std::collections::BTreeMap;
use std::fmt;

use super::LpipsError;
use super::convolution::Convolution;
use crate::raster::Real;

/// The network that LPIPS takes its features from.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum LpipsNetwork {
    /// AlexNet as in torchvision; features after each of its five convolutions.
    Alex,
    /// VGG16 as in torchvision; features after the last convolution before each pool.
    Vgg16,
}

impl fmt::Display for LpipsNetwork {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.write_str(match self {
            LpipsNetwork::Alex => "AlexNet",
            LpipsNetwork::Vgg16 => "VGG16",
        })
    }
}

/// Weights of a layer.
#[derive(Clone, Debug, PartialEq)]
pub struct WeightTensor {
    /// Lengths of the axes, the slowest first.
    pub shape: Vec<usize>,
    /// Numbers, as many as the product of the lengths, the last axis innermost.
    pub values: Vec<f32>,
}

/// The layers up to the next features.
pub(super) struct Block<T> {
    /// Window size and stride of the pool that it begins with, if any.
    pub(super) pool: Option<[usize; 2]>,
    pub(super) convolutions: Vec<Convolution<T>>,
    /// Weight of each channel of its features.
    pub(super) head: Vec<T>,
}

/// A convolution: its index in `features`; input and output channels; size, stride and padding of the
/// kernel.
struct Layer(usize, [usize; 2], [usize; 3]);

/// Pools and layers of the blocks.
type Blocks = &'static [(Option<[usize; 2]>, &'static [Layer])];

const ALEX: Blocks = &[
    (None, &[Layer(0, [3, 64], [11, 4, 2])]),
    (Some([3, 2]), &[Layer(3, [64, 192], [5, 1, 2])]),
    (Some([3, 2]), &[Layer(6, [192, 384], SMALL)]),
    (None, &[Layer(8, [384, 256], SMALL)]),
    (None, &[Layer(10, [256, 256], SMALL)]),
];

const VGG16: Blocks = &[
    (None, &[Layer(0, [3, 64], SMALL), Layer(2, [64, 64], SMALL)]),
    (HALVE, &[Layer(5, [64, 128], SMALL), Layer(7, [128, 128], SMALL)]),
    (HALVE, &[Layer(10, [128, 256], SMALL), Layer(12, [256, 256], SMALL), Layer(14, [256, 256], SMALL)]),
    (HALVE, &[Layer(17, [256, 512], SMALL), Layer(19, [512, 512], SMALL), Layer(21, [512, 512], SMALL)]),
    (HALVE, &[Layer(24, [512, 512], SMALL), Layer(26, [512, 512], SMALL), Layer(28, [512, 512], SMALL)]),
];

const SMALL: [usize; 3] = [3, 1, 1];
const HALVE: Option<[usize; 2]> = Some([2, 2]);

/// Builds the network that the shape of the first tensor identifies.
pub(super) fn build<T: Real>(
    weights: &BTreeMap<String, WeightTensor>,
) -> Result<(LpipsNetwork, Vec<Block<T>>), LpipsError> {
    let first = "features.0.weight";
    let first = weights.get(first).ok_or_else(|| LpipsError::Missing(first.into()))?;
    let (network, blocks) = match first.shape[..] {
        [_, _, 11, 11] => (LpipsNetwork::Alex, ALEX),
        [_, _, 3, 3] => (LpipsNetwork::Vgg16, VGG16),
        _ => return Err(LpipsError::Network(first.shape.clone())),
    };
    let build_block = |(i, (pool, layers)): (usize, &(Option<[usize; 2]>, &[Layer]))| {
        let build_layer = |&Layer(number, [inputs, outputs], [side, stride, padding]): &Layer| {
            let kernel =
                tensor(weights, &format!("features.{number}.weight"), &[outputs, inputs, side, side])?;
            let bias = tensor(weights, &format!("features.{number}.bias"), &[outputs])?;
            Ok(Convolution::new(&kernel, bias, side, stride, padding))
        };
        let convolutions = layers.iter().map(build_layer).collect::<Result<Vec<_>, LpipsError>>()?;
        let channels = convolutions.last().map_or(0, Convolution::outputs);
        let head = tensor(weights, &format!("lin{i}.model.1.weight"), &[1, channels, 1, 1])?;
        Ok(Block { pool: *pool, convolutions, head })
    };
    Ok((network, blocks.iter().enumerate().map(build_block).collect::<Result<_, LpipsError>>()?))
}

/// The numbers of a tensor, after checks of its shape and of its numbers.
fn tensor<T: Real>(
    weights: &BTreeMap<String, WeightTensor>,
    name: &str,
    shape: &[usize],
) -> Result<Vec<T>, LpipsError> {
    let found = weights.get(name).ok_or_else(|| LpipsError::Missing(name.into()))?;
    if found.shape != shape || found.values.len() != shape.iter().product() {
        let (expected, found) = (shape.to_vec(), found.shape.clone());
        return Err(LpipsError::Shape { tensor: name.into(), expected, found });
    }
    if found.values.iter().any(|value| !value.is_finite()) {
        return Err(LpipsError::NotFinite(name.into()));
    }
    Ok(found.values.iter().map(|value| T::from_f64(f64::from(*value))).collect())
}

//! The networks of LPIPS: their layers, and the files of their weights.

use std::fmt;

use safetensors::{Dtype, SafeTensors};

use super::LpipsError;
use super::convolution::Convolution;
use crate::fit::precision::Real;

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

/// Reads the network in a file, which the shape of its first tensor identifies.
pub(super) fn read<T: Real>(bytes: &[u8]) -> Result<(LpipsNetwork, Vec<Block<T>>), LpipsError> {
    let file = SafeTensors::deserialize(bytes).map_err(|error| LpipsError::File(error.to_string()))?;
    let first = "features.0.weight";
    let first = file.tensor(first).map_err(|_| LpipsError::Missing(first.into()))?;
    let (network, blocks) = match first.shape() {
        [_, _, 11, 11] => (LpipsNetwork::Alex, ALEX),
        [_, _, 3, 3] => (LpipsNetwork::Vgg16, VGG16),
        shape => return Err(LpipsError::Network(shape.to_vec())),
    };
    let read_block = |(i, (pool, layers)): (usize, &(Option<[usize; 2]>, &[Layer]))| {
        let read_layer = |&Layer(number, [inputs, outputs], [side, stride, padding]): &Layer| {
            let weights =
                tensor(&file, &format!("features.{number}.weight"), &[outputs, inputs, side, side])?;
            let bias = tensor(&file, &format!("features.{number}.bias"), &[outputs])?;
            Ok(Convolution::new(&weights, bias, side, stride, padding))
        };
        let convolutions = layers.iter().map(read_layer).collect::<Result<Vec<_>, LpipsError>>()?;
        let channels = convolutions.last().map_or(0, Convolution::outputs);
        let head = tensor(&file, &format!("lin{i}.model.1.weight"), &[1, channels, 1, 1])?;
        Ok(Block { pool: *pool, convolutions, head })
    };
    Ok((network, blocks.iter().enumerate().map(read_block).collect::<Result<_, LpipsError>>()?))
}

/// The numbers of a tensor, after checks of its type and shape.
fn tensor<T: Real>(file: &SafeTensors, name: &str, shape: &[usize]) -> Result<Vec<T>, LpipsError> {
    let found = file.tensor(name).map_err(|_| LpipsError::Missing(name.into()))?;
    if found.dtype() != Dtype::F32 {
        return Err(LpipsError::Type { tensor: name.into(), found: format!("{:?}", found.dtype()) });
    }
    if found.shape() != shape {
        let (expected, found) = (shape.to_vec(), found.shape().to_vec());
        return Err(LpipsError::Shape { tensor: name.into(), expected, found });
    }
    let values = found.data().as_chunks().0.iter().map(|bytes| f32::from_le_bytes(*bytes));
    if values.clone().any(|value| !value.is_finite()) {
        return Err(LpipsError::NotFinite(name.into()));
    }
    Ok(values.map(|value| T::from_f64(f64::from(value))).collect())
}

//! The distributions from which models of integers start.

use super::cdf::{Cdf, Pace, SYMBOLS};
use crate::gaussian::{Attribute, Prior};

/// Sums of the frequencies below each token, by context: Laplace distributions. From context 13 on, tokens stand for
/// twice as many numbers in every second context, and the last two rows repeat. Format.
const STARTS: [[u16; 16]; 15] = [
    [
        0, 32742, 32749, 32755, 32756, 32757, 32758, 32759, 32760, 32761, 32762, 32763, 32764, 32765, 32766,
        32767,
    ],
    [
        0, 32639, 32697, 32755, 32756, 32757, 32758, 32759, 32760, 32761, 32762, 32763, 32764, 32765, 32766,
        32767,
    ],
    [
        0, 32153, 32454, 32755, 32756, 32757, 32758, 32759, 32760, 32761, 32762, 32763, 32764, 32765, 32766,
        32767,
    ],
    [
        0, 30817, 31783, 32748, 32753, 32757, 32758, 32759, 32760, 32761, 32762, 32763, 32764, 32765, 32766,
        32767,
    ],
    [
        0, 28320, 30497, 32674, 32715, 32756, 32757, 32759, 32760, 32761, 32762, 32763, 32764, 32765, 32766,
        32767,
    ],
    [
        0, 24790, 28537, 32284, 32507, 32729, 32743, 32757, 32759, 32761, 32762, 32763, 32764, 32765, 32766,
        32767,
    ],
    [
        0, 20704, 25914, 31124, 31830, 32536, 32633, 32729, 32743, 32757, 32761, 32763, 32764, 32765, 32766,
        32767,
    ],
    [
        0, 16604, 22716, 28829, 30316, 31803, 32165, 32527, 32616, 32705, 32748, 32760, 32764, 32765, 32766,
        32767,
    ],
    [
        0, 12888, 19167, 25447, 27758, 30069, 30919, 31770, 32084, 32397, 32628, 32714, 32757, 32765, 32766,
        32767,
    ],
    [
        0, 9755, 15585, 21415, 24291, 27166, 28584, 30002, 30702, 31402, 32092, 32433, 32684, 32760, 32766,
        32767,
    ],
    [
        0, 7246, 12265, 17284, 20329, 23373, 25220, 27068, 28188, 29309, 30668, 31493, 32297, 32702, 32765,
        32767,
    ],
    [
        0, 5308, 9396, 13483, 16354, 19225, 21241, 23257, 24673, 26089, 28077, 29473, 31142, 32371, 32743,
        32767,
    ],
    [
        0, 3849, 7047, 10245, 12736, 15226, 17166, 19106, 20617, 22128, 24481, 26314, 28852, 31326, 32571,
        32763,
    ],
    [
        0, 5201, 9666, 13408, 16544, 19172, 21374, 23220, 24766, 26063, 28058, 29460, 31135, 32369, 32743,
        32767,
    ],
    [
        0, 3793, 7197, 10201, 12852, 15192, 17257, 19079, 20688, 22107, 24465, 26301, 28845, 31323, 32571,
        32763,
    ],
];

/// The distribution from which the tokens of an attribute start in a context.
pub(super) fn start(attribute: Attribute, context: usize) -> Cdf {
    let row = if context < STARTS.len() { context } else { 13 + (context - 13) % 2 };
    let starts: [u16; SYMBOLS] = STARTS[row];
    Cdf::new(starts, pace(attribute))
}

/// Shares of the cells of a square with 2^level cells along an edge by distance from its middle, for each level.
/// Format.
const SQUARES: [&[u32]; 5] = [&[1], &[1], &[10, 8], &[12, 6, 4, 4], &[16, 8, 5, 4, 3, 3, 3, 4]];

/// The share of a number of `bits` bits in the distribution from which a tree starts. Format.
pub(super) fn share(value: u32, bits: u32, prior: Prior) -> u32 {
    match prior {
        Prior::Nothing => 1,
        // Three quarters for each step away.
        Prior::Near(other) => (0..value.abs_diff(other)).fold(4096, |share, _| share * 3 / 4).max(1),
        Prior::AtMost(other) => u32::from(value <= other),
        Prior::MiddleOfSquare => {
            let level = bits / 2;
            let coordinate =
                |shift: u32| (0..level).map(|bit| (value >> (2 * bit + shift) & 1) << bit).sum::<u32>();
            let half = (1 << level) / 2;
            let distance = |x: u32| if x < half { half - 1 - x } else { x - half };
            let ring = if level == 0 { 0 } else { distance(coordinate(0)).max(distance(coordinate(1))) };
            SQUARES[level as usize][ring as usize]
        }
    }
}

/// How fast trees adapt. Format.
pub(super) fn tree_pace(prior: Prior) -> Pace {
    match prior {
        Prior::Nothing => Pace { first: 8, last: 112 },
        Prior::Near(_) | Prior::AtMost(_) => Pace { first: 24, last: 112 },
        Prior::MiddleOfSquare => Pace { first: 24, last: 48 },
    }
}

/// How fast the distribution of the tokens of an attribute adapts. Format.
fn pace(attribute: Attribute) -> Pace {
    let last = match attribute {
        Attribute::Opacity => 64,
        Attribute::Harmonics => 64,
        Attribute::Motion | Attribute::AngularRate => 144,
        _ => 88,
    };
    Pace { first: 32, last }
}

//! The distributions from which models of integers start.

use super::{
    cdf::{Cdf, Pace, SYMBOLS},
    observer::Attribute,
    token::Form,
};

/// What is known of a number before the first one is coded.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord)]
pub(crate) enum Prior {
    Nothing,
    /// It is near another number.
    Near(u32),
    /// It is at most another number.
    AtMost(u32),
    /// Its bits are the bits of two coordinates in turn, and the middle of the square is likely.
    NearCenterOfSquare,
}

/// Sums of the frequencies below each token, by context: the frequencies in packages of captured fields, at most 20,000
/// tokens of an attribute and a package, and 200 tokens of the Laplace distribution of the context's magnitude. From context 11 on, tokens stand for
/// twice as many numbers in every second context, and the last two rows repeat. Format.
pub(super) const SIGNED: [[u16; SYMBOLS]; 13] = [
    [
        0, 32136, 32397, 32635, 32678, 32728, 32740, 32749, 32753, 32757, 32761, 32762, 32764, 32765, 32766,
        32767,
    ],
    [
        0, 30226, 31268, 32367, 32538, 32651, 32685, 32717, 32735, 32748, 32756, 32758, 32763, 32765, 32766,
        32767,
    ],
    [
        0, 29073, 30609, 32255, 32427, 32599, 32652, 32710, 32724, 32738, 32750, 32758, 32761, 32764, 32766,
        32767,
    ],
    [
        0, 27252, 29421, 31939, 32225, 32498, 32573, 32668, 32694, 32718, 32740, 32752, 32761, 32764, 32766,
        32767,
    ],
    [
        0, 24627, 27771, 31470, 31948, 32385, 32504, 32607, 32648, 32694, 32731, 32751, 32760, 32764, 32766,
        32767,
    ],
    [
        0, 21620, 26038, 30673, 31423, 32170, 32340, 32514, 32579, 32643, 32701, 32726, 32751, 32760, 32764,
        32767,
    ],
    [
        0, 18515, 24064, 29536, 30660, 31739, 32045, 32335, 32434, 32534, 32644, 32692, 32735, 32761, 32766,
        32767,
    ],
    [
        0, 15149, 21254, 28093, 29671, 31133, 31611, 32049, 32221, 32398, 32559, 32632, 32712, 32751, 32764,
        32766,
    ],
    [
        0, 11369, 17201, 25975, 28131, 30030, 30804, 31475, 31789, 32054, 32350, 32500, 32648, 32732, 32762,
        32766,
    ],
    [
        0, 8281, 13813, 21492, 24355, 28016, 29314, 30355, 30966, 31386, 31927, 32227, 32512, 32689, 32752,
        32765,
    ],
    [
        0, 5859, 10627, 16134, 19340, 23916, 25804, 27963, 29002, 29887, 30920, 31545, 32187, 32589, 32739,
        32765,
    ],
    [
        0, 7273, 14082, 19996, 24894, 27681, 29825, 30746, 31478, 31829, 32270, 32485, 32654, 32737, 32762,
        32766,
    ],
    [
        0, 5295, 10348, 14979, 19243, 22743, 25712, 27666, 29263, 30182, 31361, 31961, 32444, 32681, 32751,
        32764,
    ],
];

/// The row of a context in the table of a form: the last two repeat. Format.
pub(super) fn row(form: Form, context: usize) -> usize {
    let halved = form.whole_contexts() + 2;
    if context < halved + 2 { context } else { halved + (context - halved) % 2 }
}

/// The distribution from which the tokens of an attribute start in a context.
pub(super) fn start(attribute: Attribute, context: usize) -> Cdf {
    let form = Form::new(attribute);
    let row = row(form, context);
    let starts = match form {
        Form::Natural => NATURAL[row],
        Form::Signed => SIGNED[row],
    };
    Cdf::new(starts, pace(attribute))
}

pub(super) const NATURAL: [[u16; SYMBOLS]; 17] = [
    [
        0, 32742, 32754, 32755, 32756, 32757, 32758, 32759, 32760, 32761, 32762, 32763, 32764, 32765, 32766,
        32767,
    ],
    [
        0, 32639, 32754, 32755, 32756, 32757, 32758, 32759, 32760, 32761, 32762, 32763, 32764, 32765, 32766,
        32767,
    ],
    [
        0, 31929, 32754, 32755, 32756, 32757, 32758, 32759, 32760, 32761, 32762, 32763, 32764, 32765, 32766,
        32767,
    ],
    [
        0, 29947, 31924, 32048, 32049, 32050, 32522, 32641, 32642, 32643, 32762, 32763, 32764, 32765, 32766,
        32767,
    ],
    [
        0, 27291, 30628, 31232, 31549, 31917, 32076, 32287, 32288, 32289, 32395, 32658, 32712, 32713, 32766,
        32767,
    ],
    [
        0, 26933, 30930, 31561, 31885, 32177, 32294, 32382, 32441, 32500, 32646, 32647, 32706, 32736, 32766,
        32767,
    ],
    [
        0, 25154, 29404, 30530, 31060, 31477, 31942, 32106, 32283, 32385, 32511, 32600, 32676, 32765, 32766,
        32767,
    ],
    [
        0, 23787, 28132, 29409, 30345, 31017, 31497, 31775, 32000, 32172, 32307, 32480, 32593, 32743, 32766,
        32767,
    ],
    [
        0, 22144, 26491, 28330, 29423, 30259, 30833, 31289, 31636, 31873, 32238, 32409, 32641, 32746, 32766,
        32767,
    ],
    [
        0, 19644, 24459, 26660, 28033, 29104, 29936, 30641, 31167, 31516, 31987, 32283, 32611, 32758, 32766,
        32767,
    ],
    [
        0, 15781, 20477, 23442, 25587, 27275, 28612, 29584, 30353, 30923, 31747, 32150, 32525, 32733, 32762,
        32767,
    ],
    [
        0, 12576, 16834, 20008, 22551, 24606, 26264, 27681, 28852, 29756, 31052, 31840, 32447, 32713, 32763,
        32767,
    ],
    [
        0, 9416, 12507, 15152, 17623, 19892, 21882, 23719, 25395, 26834, 29053, 30514, 31867, 32558, 32742,
        32766,
    ],
    [0, 5557, 7474, 9485, 11996, 14629, 17148, 19585, 21828, 23653, 26720, 28879, 31094, 32276, 32683, 32763],
    [
        0, 6002, 8288, 10017, 11761, 13533, 15236, 16976, 18577, 20173, 23081, 25460, 28687, 31142, 32442,
        32749,
    ],
    [0, 4223, 5696, 7234, 8841, 10541, 20159, 26640, 27977, 29007, 30529, 31321, 32117, 32687, 32749, 32764],
    [0, 4786, 6343, 7830, 9252, 10767, 12235, 13690, 16992, 22518, 25028, 27163, 30209, 32503, 32743, 32763],
];

/// Shares of the cells of a square with 2^level cells along an edge by distance from its middle, for each level.
/// Format.
pub(super) const SQUARES: [&[u32]; 5] = [&[1], &[1], &[10, 8], &[12, 6, 4, 4], &[16, 8, 5, 4, 3, 3, 3, 4]];

/// The share of a number of `bits` bits in the distribution from which a tree starts. Format.
pub(super) fn share(value: u32, bits: u32, prior: Prior) -> u32 {
    match prior {
        Prior::Nothing => 1,
        // Three quarters for each step away.
        Prior::Near(other) => (0..value.abs_diff(other)).fold(4096, |share, _| share * 3 / 4).max(1),
        Prior::AtMost(other) => u32::from(value <= other),
        Prior::NearCenterOfSquare => {
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
        Prior::Near(_) => Pace { first: 8, last: 56 },
        Prior::AtMost(_) => Pace { first: 48, last: 220 },
        Prior::NearCenterOfSquare => Pace { first: 24, last: 64 },
    }
}

/// How fast the distribution of the tokens of an attribute adapts. Format.
fn pace(attribute: Attribute) -> Pace {
    Pace { first: 32, last: if attribute == Attribute::Color { 88 } else { 220 } }
}

//! [`Segments`]: which parts of a take a process fits.

use std::ops::Range;
use std::str::FromStr;

use program::Fault;

use crate::parse;
use crate::takes::Shard;

/// Parts that one machine of several fits.
#[derive(Clone, Debug, PartialEq, Eq)]
pub enum Segments {
    /// 0, 2, 4 and so on, each by itself.
    Even,
    /// 1, 3, 5 and so on, each between two that are finished.
    Odd,
    /// A range, one after another.
    Range(Range<usize>),
}

impl std::fmt::Display for Segments {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        match self {
            Segments::Even => f.write_str("even"),
            Segments::Odd => f.write_str("odd"),
            Segments::Range(Range { start, end }) => write!(f, "{start}..{end}"),
        }
    }
}

impl FromStr for Segments {
    type Err = String;

    /// From `even`, `odd` or `A..B`.
    fn from_str(text: &str) -> Result<Segments, String> {
        match text {
            "even" => Ok(Segments::Even),
            "odd" => Ok(Segments::Odd),
            _ => parse::range(text)
                .map(Segments::Range)
                .ok_or_else(|| "even, odd, or A..B with A below B".into()),
        }
    }
}

impl Segments {
    /// The numbers of the parts of a shard, of a take of `count` parts.
    ///
    /// # Errors
    /// [`Fault::Usage`] if the take has fewer parts than a range.
    pub(super) fn numbers(&self, shard: Shard, count: usize) -> Result<Vec<usize>, Fault> {
        let every_other = |first: usize| shard.select((first..count).step_by(2)).collect();
        match self {
            Segments::Even => Ok(every_other(0)),
            Segments::Odd => Ok(every_other(1)),
            Segments::Range(range) if range.end > count => Err(Fault::Usage(format!(
                "--segments {self}: the take has {count} parts, 0..{count}; see --split"
            ))),
            Segments::Range(range) => Ok(range.clone().collect()),
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn shards_of_even_and_odd_parts_share_all_out() {
        for count in [1, 2, 7, 8] {
            let mut all = Vec::new();
            for segments in [Segments::Even, Segments::Odd] {
                for shard in ["0/3", "1/3", "2/3"] {
                    let numbers = segments.numbers(shard.parse().unwrap(), count).unwrap();
                    let rest = usize::from(segments == Segments::Odd);
                    assert!(numbers.iter().all(|number| number % 2 == rest));
                    all.extend(numbers);
                }
            }
            all.sort_unstable();
            assert_eq!(all, (0..count).collect::<Vec<_>>());
        }
    }

    #[test]
    fn a_range_is_within_the_take() {
        let range: Segments = "3..5".parse().unwrap();
        assert_eq!(range.numbers(Shard::ALL, 5).unwrap(), [3, 4]);
        assert!(matches!(range.numbers(Shard::ALL, 4), Err(Fault::Usage(_))));
        for text in ["", "3", "3..", "..3", "5..3", "3..3", "-1..3", "all", "3..5..7"] {
            assert!(text.parse::<Segments>().is_err(), "{text}");
        }
    }
}

//! Values in text, as options and files state them: three numbers, ranges.

use std::ops::Range;
use std::str::FromStr;

/// Three numbers with `separator` between them.
pub(crate) fn three_numbers<T: FromStr>(text: &str, separator: char) -> Option<[T; 3]> {
    let numbers: Option<Vec<T>> = text.split(separator).map(|number| number.trim().parse().ok()).collect();
    numbers?.try_into().ok()
}

/// A range that is not empty: A..B.
pub(crate) fn range(text: &str) -> Option<Range<usize>> {
    let (start, end) = text.split_once("..")?;
    Some(start.parse().ok()?..end.parse().ok()?).filter(|range: &Range<usize>| !range.is_empty())
}

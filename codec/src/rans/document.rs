//! Tests that FORMAT.md states the tables of this coder as they are in the code: readers of other makers use them.

use super::{
    math::{LOGARITHMS, POWERS},
    start::{NATURAL, SIGNED, SQUARES},
    token::BASES,
};

const DOCUMENT: &str = include_str!("../../FORMAT.md");

/// The words of the paragraphs after `opening` that are indented as a table.
fn table_after(opening: &str) -> Vec<&'static str> {
    let (_, rest) = DOCUMENT.split_once(opening).unwrap_or_else(|| panic!("FORMAT.md says: {opening}"));
    let lines = rest.lines().skip_while(|line| !line.starts_with("    "));
    let rows = lines.take_while(|line| line.starts_with("    "));
    // The context before each row of distributions.
    rows.flat_map(str::split_whitespace).filter(|word| !word.ends_with(':')).collect()
}

#[test]
fn the_document_has_the_distributions_of_the_code() {
    let flat = |rows: &[[u16; 16]]| rows.as_flattened().iter().map(u16::to_string).collect::<Vec<_>>();
    assert_eq!(table_after("\nSigned, c[0] to c[15]"), flat(&SIGNED));
    assert_eq!(table_after("\nNatural, for contexts"), flat(&NATURAL));
}

#[test]
fn the_document_has_the_numbers_of_exponential_and_logarithm() {
    let bits = |numbers: &[u64]| numbers.iter().map(|number| format!("{number:016x}")).collect::<Vec<_>>();
    assert_eq!(table_after("\nE[j] is 2^(j / 64)"), bits(&POWERS));
    assert_eq!(table_after("\nL[j] is -ln(128 / (129 + 2 j))"), bits(&LOGARITHMS));
}

#[test]
fn the_document_has_the_bases_of_tokens_and_the_shares_of_squares() {
    let words = |numbers: &[u32]| numbers.iter().map(u32::to_string).collect::<Vec<_>>().join(" ");
    assert!(DOCUMENT.contains(&format!("has the base {}.", words(&BASES))));
    let [_, _, two, three, four] = SQUARES.map(words);
    let shares =
        format!("1 for levels 0 and 1, {two} for level 2, {three} for level 3, and {four} for level 4.");
    assert!(DOCUMENT.contains(&shares), "{shares}");
}

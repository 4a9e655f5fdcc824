//! [`Account`]: what reading a file repaired, assumed and lost.

use std::collections::BTreeMap;
use std::fmt;

/// The reason of [`Repairs::dropped`] for rows that the header announces and the file lacks.
pub(crate) const TRUNCATED: &str = "truncated payload";

/// The reason of [`Repairs::repaired`] for rows with more SH than a field holds.
pub(crate) const SH_CUT: &str = "SH above degree 3 left out";

/// The difference between a file and the field that was made of it.
#[derive(Clone, Debug, Default, PartialEq, Eq)]
pub struct Account {
    /// Changes made to satisfy the field's invariants.
    pub repairs: Repairs,
    /// What the reader assumed where the format is silent and programs differ, and what it made of a sequence; each the
    /// rest of a note that names the file.
    pub assumed: Vec<String>,
    /// What the file has and the field does not; each the rest of a note that names the file.
    pub lost: Vec<String>,
}

/// Rows repaired or dropped on import, counted by reason.
#[derive(Clone, Debug, Default, PartialEq, Eq)]
pub struct Repairs {
    /// Reason to number of repaired rows.
    pub repaired: BTreeMap<&'static str, usize>,
    /// Reason to number of dropped rows.
    pub dropped: BTreeMap<&'static str, usize>,
}

impl Account {
    /// All that there is to say: the repairs if there are any, then the notes.
    pub fn sentences(&self) -> Vec<String> {
        let repairs = (!self.repairs.is_empty()).then(|| self.repairs.to_string());
        repairs.into_iter().chain(self.notes()).collect()
    }

    /// What was assumed, then what was lost. Control characters, which headers may contain, are escaped.
    pub fn notes(&self) -> impl Iterator<Item = String> {
        self.assumed.iter().chain(&self.lost).map(|note| one_line(note).take(NOTE_MAX).collect())
    }
}

/// Most characters of a note: a comment of a file can be long.
const NOTE_MAX: usize = 500;

/// The characters of a text on one line: control characters are escaped.
pub(crate) fn one_line(text: &str) -> impl Iterator<Item = char> {
    text.chars().flat_map(|c| {
        let escaped = c.is_control().then(|| c.escape_default());
        let plain = (!c.is_control()).then_some(c);
        escaped.into_iter().flatten().chain(plain)
    })
}

impl From<Repairs> for Account {
    fn from(repairs: Repairs) -> Account {
        Account { repairs, ..Account::default() }
    }
}

impl Repairs {
    /// Whether no row was changed.
    pub fn is_empty(&self) -> bool {
        self.repaired.is_empty() && self.dropped.is_empty()
    }

    /// The repairs of a table that ends `rows` rows early.
    pub(crate) fn truncated(rows: usize) -> Repairs {
        let mut repairs = Repairs::default();
        repairs.drop_rows(TRUNCATED, rows);
        repairs
    }

    /// Adds the counts of another file.
    pub(crate) fn add(&mut self, other: &Repairs) {
        other.repaired.iter().for_each(|(reason, &rows)| self.repair_rows(reason, rows));
        other.dropped.iter().for_each(|(reason, &rows)| self.drop_rows(reason, rows));
    }

    pub(crate) fn repair_rows(&mut self, reason: &'static str, rows: usize) {
        if rows > 0 {
            *self.repaired.entry(reason).or_default() += rows;
        }
    }

    pub(crate) fn drop_rows(&mut self, reason: &'static str, rows: usize) {
        if rows > 0 {
            *self.dropped.entry(reason).or_default() += rows;
        }
    }
}

/// The parts that are lost, of pairs of whether a part is and its name.
pub(crate) fn listed<const N: usize>(parts: [(bool, &'static str); N]) -> Vec<&'static str> {
    parts.into_iter().filter_map(|(is_lost, part)| is_lost.then_some(part)).collect()
}

/// One line, such as `repaired 3 (zero quaternion: 3), dropped 1 (non-finite centre: 1)`, or
/// `nothing to repair`.
impl fmt::Display for Repairs {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let part = |verb: &str, counts: &BTreeMap<&'static str, usize>| {
            let reasons: Vec<String> = counts.iter().map(|(reason, n)| format!("{reason}: {n}")).collect();
            (!counts.is_empty())
                .then(|| format!("{verb} {} ({})", counts.values().sum::<usize>(), reasons.join(", ")))
        };
        let parts: Vec<String> = [part("repaired", &self.repaired), part("dropped", &self.dropped)]
            .into_iter()
            .flatten()
            .collect();
        f.write_str(if parts.is_empty() { "nothing to repair" } else { "" })?;
        f.write_str(&parts.join(", "))
    }
}

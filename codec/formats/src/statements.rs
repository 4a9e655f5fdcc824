//! [`Statement`]: what a file of another program can say, and what its reader does with it.
//!
//! Each reader declares the statements that it knows, and reads no other. `xtask/README.md` shows them in one table,
//! which a test holds to them.

/// A statement that files of a format can make.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Statement {
    /// Its name in the file; `*` stands for any end.
    pub name: &'static str,
    /// What the reader does with it.
    pub treatment: Treatment,
    /// What it says, or why it is ignored.
    pub meaning: &'static str,
}

/// What a reader does with a statement.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Treatment {
    /// The field is what it says.
    Honoured,
    /// It is named in a note, and the field is as without it.
    Noted,
    /// It changes nothing that is drawn.
    Ignored,
}

impl Treatment {
    /// Its word in the table.
    pub fn word(self) -> &'static str {
        match self {
            Treatment::Honoured => "honoured",
            Treatment::Noted => "noted",
            Treatment::Ignored => "ignored",
        }
    }
}

pub(crate) const fn honoured(name: &'static str, meaning: &'static str) -> Statement {
    Statement { name, treatment: Treatment::Honoured, meaning }
}

pub(crate) const fn noted(name: &'static str, meaning: &'static str) -> Statement {
    Statement { name, treatment: Treatment::Noted, meaning }
}

pub(crate) const fn ignored(name: &'static str, meaning: &'static str) -> Statement {
    Statement { name, treatment: Treatment::Ignored, meaning }
}

/// What a reader does with the statement of this name; unknown ones are noted.
pub(crate) fn treatment(statements: &[Statement], name: &str) -> Treatment {
    let is_it = |statement: &&Statement| {
        statement.name.split(' ').any(|pattern| match pattern.strip_suffix('*') {
            Some(start) => !start.is_empty() && name.starts_with(start),
            None => pattern == name,
        })
    };
    statements.iter().find(is_it).map_or(Treatment::Noted, |statement| statement.treatment)
}

/// The names of statements that were not read, as a list, without those that change nothing.
pub(crate) fn unread<'n>(statements: &[Statement], names: impl Iterator<Item = &'n str>) -> Option<String> {
    list_of(names.filter(|name| treatment(statements, name) != Treatment::Ignored))
}

/// Names as a list: the first ones, and how many more there are; `None` if there are none.
pub fn list_of<'n>(names: impl Iterator<Item = &'n str>) -> Option<String> {
    let mut names: Vec<&str> = names.collect();
    names.dedup();
    let more = names.len().saturating_sub(NAMES_MAX);
    names.truncate(NAMES_MAX);
    let more = if more > 0 { format!(" and {more} more") } else { String::new() };
    (!names.is_empty()).then(|| names.join(", ") + &more)
}

/// Most names in a note.
pub(crate) const NAMES_MAX: usize = 8;

//! Words that names in code avoid, each with the field's word for it.

use super::tokens::{Kind, Token};

/// A term to avoid in names.
pub(crate) struct Term {
    /// One or more words in snake case; it matches in any case, in the singular and the plural.
    pub(crate) avoid: &'static str,
    pub(crate) prefer: &'static str,
    /// Paths where the word has another meaning, each with that meaning.
    pub(crate) elsewhere: &'static [(&'static str, &'static str)],
}

const fn term(
    avoid: &'static str,
    prefer: &'static str,
    elsewhere: &'static [(&'static str, &'static str)],
) -> Term {
    Term { avoid, prefer, elsewhere }
}

pub(crate) const TERMS: &[Term] = &[
    term("rectangle", "quad", &[]),
    term("in_sight", "cull", &[]),
    term("mark_seen", "cull", &[]),
    term("sieve", "Culler", &[]),
    term("faint", "culled", &[]),
    term("least_px", "min_contribution_px", &[]),
    term("middle", "origin, center", &[]),
    term("still", "static", &[]),
    term("moving", "dynamic", &[]),
    term("reach", "support_radius", &[]),
    term("told", "LoadEvent, event", &[]),
    term("news", "LoadEvent", &[]),
    term("brought", "LoadEvent", &[]),
    term("awaited", "is_blocking", &[]),
    term("hurries", "skip_requested", &[]),
    term("kept", "cached, retained", &[]),
    term("address", "url", &[]),
    term("shown", "redacted, visible", &[]),
    term("footage", "Capture", &[]),
    term("cut", "FrameSelection", &[]),
    term("shot", "TrainingView, PosedView", &[]),
    term("pull", "gradient accumulator", &[]),
    term("pace", "StepConfig", &[]),
    term("doubling", "densification", &[]),
    term("clock", "Timeline", &[]),
    term("exponential", "exp", &[]),
    term("learn", "update", &[]),
    term("class", "quantiser index", &[]),
    term("contrast", "quantiser index", &[]),
    term("wanted", "target", &[]),
    term("past", "History", &[]),
    term("spin", "angular rate", &[]),
    term("watch", "BitObserver", &[]),
    term("tally", "BitStats", &[]),
    term("beam", "pointer ray", &[]),
    term("board", "panel quad", &[]),
    term("see_through", "passthrough", &[]),
    term("life", "SessionLifecycle", &[]),
    term("knob", "parameter", &[]),
    term("ladder", "prefix quality", &[]),
    term("rung", "step", &[]),
    term("fine_tune", "Refinement", &[]),
    term("fine_tuned", "Refinement", &[]),
    term("fine_tuning", "Refinement", &[]),
    term("refit", "recolor", &[]),
];

/// Names of more words are sentences: those of tests.
const WORDS_MAX: usize = 4;

/// The names in a file that hold a term to avoid, each with its line and the term.
pub(crate) fn avoided<'a>(path: &str, tokens: &[Token<'a>]) -> Vec<(usize, &'a str, &'static Term)> {
    let terms = TERMS.iter().filter(|term| !term.elsewhere.iter().any(|(home, _)| path.starts_with(home)));
    let terms: Vec<_> =
        terms.map(|term| (format!("_{}_", term.avoid), format!("_{}s_", term.avoid), term)).collect();
    let mut found = Vec::new();
    for token in tokens.iter().filter(|token| token.kind == Kind::Word) {
        let name = snake(token.text);
        if name.split('_').count() <= WORDS_MAX {
            let name = format!("_{name}_");
            let matches = terms.iter().filter(|(one, many, _)| name.contains(one) || name.contains(many));
            found.extend(matches.map(|&(_, _, term)| (token.line, token.text, term)));
        }
    }
    found
}

/// A name in snake case, whatever its case was.
pub(crate) fn snake(name: &str) -> String {
    let letters: Vec<char> = name.chars().collect();
    let mut snake = String::with_capacity(name.len() + 4);
    for (i, letter) in letters.iter().enumerate() {
        let before = i.checked_sub(1).map(|i| letters[i]);
        let begins = letter.is_uppercase()
            && before.is_some_and(|before| {
                before.is_lowercase()
                    || before.is_numeric()
                    || (before.is_uppercase() && letters.get(i + 1).is_some_and(|c| c.is_lowercase()))
            });
        if begins {
            snake.push('_');
        }
        snake.extend(letter.to_lowercase());
    }
    snake
}

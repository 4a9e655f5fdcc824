//! Words that names in code avoid, each with the field's word for it.

use super::tokens::{Kind, Token};

/// A term to avoid in names.
pub(crate) struct Term {
    /// One or more words in snake case; it matches in any case, in the singular and the plural.
    pub(crate) avoid: &'static str,
    pub(crate) prefer: &'static str,
    /// Folders in which the word has the meaning to avoid.
    pub(crate) scopes: &'static [&'static str],
    /// Paths within the scopes where it means something else.
    pub(crate) elsewhere: &'static [&'static str],
}

const fn term(
    avoid: &'static str,
    prefer: &'static str,
    scopes: &'static [&'static str],
    elsewhere: &'static [&'static str],
) -> Term {
    Term { avoid, prefer, scopes, elsewhere }
}

const EVERYWHERE: &[&str] = &[""];

/// Where clips are loaded, and the tests of it.
const LOADING: &[&str] =
    &["client/src/clips/", "client/src/net/", "client/src/window/", "client/src/xr/", "tests/tests/"];

pub(crate) const TERMS: &[Term] = &[
    term("rectangle", "quad", EVERYWHERE, &["codec/refine/src/reference/tests.rs"]),
    term("in_sight", "cull", EVERYWHERE, &[]),
    term("mark_seen", "cull", EVERYWHERE, &[]),
    term("sieve", "culler", EVERYWHERE, &[]),
    term("faint", "culled", &["client/src/gpu/"], &[]),
    term("least_px", "min_contribution_px", EVERYWHERE, &[]),
    term("middle", "origin, center", &["codec/src/", "client/src/clips/", "client/src/gpu/pack"], &[]),
    // The range of a search, and of a filter's window.
    term("reach", "support_radius", EVERYWHERE, &["codec/refine/src/anchor/", "codec/refine/src/fit/loss/"]),
    term("told", "event", LOADING, &["client/src/xr/interaction/"]),
    term("news", "event", EVERYWHERE, &[]),
    term("brought", "event", EVERYWHERE, &[]),
    term("awaited", "is_blocking", EVERYWHERE, &[]),
    term("hurries", "skip_requested", EVERYWHERE, &[]),
    term("kept", "cached", LOADING, &[]),
    // Of the network.
    term("address", "url", LOADING, &["client/src/net/request.rs"]),
    term("shown", "redacted", &["client/src/clips/", "client/src/net/"], &[]),
    term("footage", "Capture", EVERYWHERE, &[]),
    term("cut", "FrameSelection", &["xtask/studio/src/capture/", "xtask/studio/src/fit/"], &[]),
    term("shot", "TrainingView, PosedView", EVERYWHERE, &[]),
    // In a line's colours, and in a filter.
    term("pull", "gradient", &["codec/refine/", "shaders/"], &["codec/refine/src/fit/loss/"]),
    term("pace", "StepConfig", &["codec/refine/", "shaders/"], &[]),
    term("doubling", "densification", &["codec/refine/"], &[]),
    term("clock", "Timeline", &["codec/refine/"], &[]),
    term("exponential", "exp", EVERYWHERE, &[]),
    term("learn", "update", &["codec/src/"], &[]),
    term("class", "quantiser index", &["codec/src/context/"], &[]),
    term("contrast", "quantiser index", &["codec/src/context/"], &[]),
    term("wanted", "target", &["codec/src/"], &[]),
    term("past", "history", &["codec/src/"], &[]),
    term("spin", "angular rate", EVERYWHERE, &[]),
    term("watch", "observer", &["codec/src/"], &[]),
    term("tally", "stats", &["codec/src/"], &[]),
    term("beam", "ray", EVERYWHERE, &[]),
    term("board", "panel quad", EVERYWHERE, &[]),
    term("see_through", "passthrough", EVERYWHERE, &[]),
    term("life", "lifecycle", &["client/src/xr/"], &[]),
    term("knob", "parameter", EVERYWHERE, &[]),
    term("ladder", "prefix quality", EVERYWHERE, &[]),
    term("rung", "step", EVERYWHERE, &[]),
    term("fine_tune", "refinement", EVERYWHERE, &[]),
    term("fine_tuned", "refinement", EVERYWHERE, &[]),
    term("fine_tuning", "refinement", EVERYWHERE, &[]),
    term("refit", "recolor", EVERYWHERE, &[]),
];

/// Names of more words are sentences: those of tests.
const WORDS_MAX: usize = 4;

/// The names in a file that hold a term to avoid, each with its line and the term.
pub(crate) fn avoided<'a>(path: &str, tokens: &[Token<'a>]) -> Vec<(usize, &'a str, &'static Term)> {
    let lies_in = |folders: &[&str]| folders.iter().any(|folder| path.starts_with(folder));
    let terms = TERMS.iter().filter(|term| lies_in(term.scopes) && !lies_in(term.elsewhere));
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

/// A name of any case in snake case.
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

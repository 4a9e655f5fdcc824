//! Rust source as tokens: words, marks and literals with their lines, comments dropped.

/// What a token is.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) enum Kind {
    /// An identifier or keyword.
    Word,
    /// Punctuation: one character, or `::`.
    Mark,
    /// A string, character, number or lifetime.
    Literal,
}

/// One token and the line it begins in, from 1.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Token<'a> {
    pub(crate) text: &'a str,
    pub(crate) kind: Kind,
    pub(crate) line: usize,
}

/// Splits a source file into tokens.
pub(crate) fn tokens(source: &str) -> Vec<Token<'_>> {
    let mut found = Vec::new();
    let (mut at, mut line) = (0, 1);
    while let Some(first) = source[at..].chars().next() {
        let rest = &source[at..];
        let (length, kind) = if rest.starts_with("//") {
            (rest.find('\n').unwrap_or(rest.len()), None)
        } else if rest.starts_with("/*") {
            (block_comment(rest), None)
        } else if first.is_whitespace() {
            (first.len_utf8(), None)
        } else if let Some(length) = string(rest) {
            (length, Some(Kind::Literal))
        } else if first == '\'' {
            (quoted_or_lifetime(rest), Some(Kind::Literal))
        } else if first.is_ascii_digit() {
            (number(rest), Some(Kind::Literal))
        } else if first.is_alphabetic() || first == '_' {
            (word(rest), Some(Kind::Word))
        } else if rest.starts_with("::") {
            (2, Some(Kind::Mark))
        } else {
            (first.len_utf8(), Some(Kind::Mark))
        };
        let text = &rest[..length];
        found.extend(kind.map(|kind| Token { text: text.strip_prefix("r#").unwrap_or(text), kind, line }));
        line += text.matches('\n').count();
        at += length;
    }
    found
}

fn block_comment(rest: &str) -> usize {
    let (mut depth, mut at) = (0, 0);
    loop {
        if rest[at..].starts_with("/*") {
            (depth, at) = (depth + 1, at + 2);
        } else if rest[at..].starts_with("*/") {
            (depth, at) = (depth - 1, at + 2);
        } else {
            at += rest[at..].chars().next().map_or(0, char::len_utf8);
        }
        if depth == 0 || at >= rest.len() {
            return at;
        }
    }
}

/// Length of the string literal that the text begins with: plain, byte, C or raw.
fn string(rest: &str) -> Option<usize> {
    let prefix = rest.find(|c| !matches!(c, 'b' | 'c' | 'r'))?;
    if prefix > 2 {
        return None;
    }
    let hashes = rest[prefix..].bytes().take_while(|&b| b == b'#').count();
    let open = prefix + hashes;
    if rest.as_bytes().get(open) != Some(&b'"') || (hashes > 0 && !rest[..prefix].ends_with('r')) {
        return None;
    }
    if rest[..prefix].ends_with('r') {
        let close = format!("\"{}", "#".repeat(hashes));
        let end = rest[open + 1..].find(&close).map_or(rest.len(), |i| open + 1 + i + close.len());
        return Some(end);
    }
    Some(until_unescaped(rest, open + 1, b'"'))
}

/// Index behind the next `end` that no backslash precedes.
fn until_unescaped(rest: &str, from: usize, end: u8) -> usize {
    let bytes = rest.as_bytes();
    let mut at = from;
    while at < bytes.len() && bytes[at] != end {
        at += 1 + usize::from(bytes[at] == b'\\');
    }
    (at + 1).min(rest.len())
}

fn quoted_or_lifetime(rest: &str) -> usize {
    let mut after = rest[1..].chars();
    match (after.next(), after.next()) {
        (Some('\\'), _) => until_unescaped(rest, 1, b'\''),
        (Some(c), Some('\'')) => 2 + c.len_utf8(),
        _ => 1 + word(&rest[1..]),
    }
}

/// Length of a number. A dot belongs to it if a digit follows, so that ranges and methods do not.
fn number(rest: &str) -> usize {
    let part = |from: usize| from + word(&rest[from..]);
    let whole = part(0);
    let after = &rest.as_bytes()[whole..];
    match after {
        [b'.', digit, ..] if digit.is_ascii_digit() => part(whole + 1),
        _ => whole,
    }
}

fn word(rest: &str) -> usize {
    let from = if rest.starts_with("r#") { 2 } else { 0 };
    rest[from..].find(|c: char| !c.is_alphanumeric() && c != '_').map_or(rest.len(), |i| from + i)
}

/// Index behind the group whose opening bracket is at `open`.
pub(crate) fn group_end(tokens: &[Token<'_>], open: usize) -> usize {
    let mut depth = 0;
    for (i, token) in tokens.iter().enumerate().skip(open) {
        if token.kind == Kind::Mark {
            match token.text {
                "(" | "[" | "{" => depth += 1,
                ")" | "]" | "}" => depth -= 1,
                _ => {}
            }
        }
        if depth == 0 {
            return i + 1;
        }
    }
    tokens.len()
}

/// Index behind the item that begins at `start`: its `;`, or the group in braces of its body.
pub(crate) fn item_end(tokens: &[Token<'_>], start: usize) -> usize {
    let mut at = start;
    while let Some(token) = tokens.get(at) {
        match (token.kind, token.text) {
            (Kind::Mark, ";") => return at + 1,
            (Kind::Mark, "{") => return group_end(tokens, at),
            (Kind::Mark, "(" | "[") => at = group_end(tokens, at),
            _ => at += 1,
        }
    }
    tokens.len()
}

/// The tokens without items under `#[cfg(test)]`; none if the whole file is.
pub(crate) fn without_tests<'a>(tokens: &[Token<'a>]) -> Vec<Token<'a>> {
    let mut left = Vec::with_capacity(tokens.len());
    let mut at = 0;
    while at < tokens.len() {
        let texts = |at: usize, n: usize| tokens[at..].iter().take(n).map(|t| t.text);
        if texts(at, 8).eq(["#", "!", "[", "cfg", "(", "test", ")", "]"]) {
            return Vec::new();
        }
        if texts(at, 7).eq(["#", "[", "cfg", "(", "test", ")", "]"]) {
            at += 7;
            while texts(at, 2).eq(["#", "["]) {
                at = group_end(tokens, at + 1);
            }
            // `use a::{b};` ends with its semicolon, not with the braces.
            let is_use = tokens[at..].iter().take_while(|t| t.text != ";" && t.text != "{");
            let is_use = is_use.clone().any(|t| t.text == "use");
            at = if is_use {
                tokens[at..].iter().position(|t| t.text == ";").map_or(tokens.len(), |i| at + i + 1)
            } else {
                item_end(tokens, at)
            };
        } else {
            left.push(tokens[at]);
            at += 1;
        }
    }
    left
}

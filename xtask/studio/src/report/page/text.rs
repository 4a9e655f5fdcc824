//! Formats numbers and text as HTML.

/// Escapes text for HTML.
pub(super) fn escape(text: &str) -> String {
    text.replace('&', "&amp;").replace('<', "&lt;").replace('>', "&gt;").replace('"', "&quot;")
}

/// Escapes text for HTML; text between backticks becomes code.
pub(super) fn prose(text: &str) -> String {
    let mut marks = ["<code>", "</code>"].into_iter().cycle();
    let mut parts = text.split('`');
    let first = escape(parts.next().unwrap_or_default());
    parts.fold(first, |text, part| text + marks.next().unwrap_or_default() + &escape(part))
}

/// Rounds to a whole number, with commas between groups of three digits.
pub(super) fn grouped(x: f64) -> String {
    let digits = format!("{:.0}", x.abs());
    let mut text = String::new();
    for (i, digit) in digits.chars().enumerate() {
        if i > 0 && (digits.len() - i).is_multiple_of(3) {
            text.push(',');
        }
        text.push(digit);
    }
    if x < 0.0 && digits != "0" { format!("-{text}") } else { text }
}

/// A number with this many decimals, or a dash for `None`.
pub(super) fn decimals(x: Option<f64>, decimals: usize) -> String {
    x.map_or_else(|| "-".into(), |x| format!("{x:.decimals$}"))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn digits_are_grouped() {
        let grouped = [0.0, 999.0, 1000.0, 1_234_567.8, -0.2, -12_345.0].map(grouped);
        assert_eq!(grouped, ["0", "999", "1,000", "1,234,568", "0", "-12,345"]);
    }

    #[test]
    fn markup_is_escaped() {
        assert_eq!(escape("<a href=\"b\">&"), "&lt;a href=&quot;b&quot;&gt;&amp;");
        assert_eq!(prose("a `b<` c"), "a <code>b&lt;</code> c");
        assert_eq!((decimals(Some(1.25), 1), decimals(None, 1)), ("1.2".into(), "-".into()));
    }
}

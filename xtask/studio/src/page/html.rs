//! HTML: numbers, text and tables.

use std::fmt::Write;

/// Escapes text for HTML.
pub(crate) fn escape(text: &str) -> String {
    text.replace('&', "&amp;").replace('<', "&lt;").replace('>', "&gt;").replace('"', "&quot;")
}

/// Escapes text for HTML; text between backticks becomes code.
pub(crate) fn prose(text: &str) -> String {
    let mut marks = ["<code>", "</code>"].into_iter().cycle();
    let mut parts = text.split('`');
    let first = escape(parts.next().unwrap_or_default());
    parts.fold(first, |text, part| text + marks.next().unwrap_or_default() + &escape(part))
}

/// Rounds to a whole number, with commas between groups of three digits.
pub(crate) fn grouped(x: f64) -> String {
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
pub(crate) fn decimals(x: Option<f64>, decimals: usize) -> String {
    x.map_or_else(|| "-".into(), |x| format!("{x:.decimals$}"))
}

/// A page of parts, each with its title and its body, both HTML. It loads nothing.
pub(crate) fn page(parts: &[(&str, &str)]) -> String {
    let title = parts.first().map_or("", |(title, _)| title);
    let mut text = format!(
        "<!doctype html>\n<html lang=en><head><meta charset=utf-8>\n\
         <meta name=viewport content=\"width=device-width, initial-scale=1\">\n\
         <title>{title}</title>\n<style>\n{}</style></head><body>\n",
        include_str!("style.css")
    );
    for (title, body) in parts {
        let _ = writeln!(text, "<h1>{title}</h1>\n{body}");
    }
    text + "</body></html>\n"
}

/// A row of a table; `cell` is `td` or `th`, `attributes` begin with a space.
pub(crate) fn row(cell: &str, cells: &[String], attributes: &str) -> String {
    let mut text = format!("<tr{attributes}>");
    for content in cells {
        let _ = write!(text, "<{cell}>{content}</{cell}>");
    }
    text + "</tr>\n"
}

/// A table of these rows.
pub(crate) fn table(rows: &str) -> String {
    format!("<div class=wide><table>\n{rows}</table></div>\n")
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

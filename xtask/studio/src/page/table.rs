//! [`Table`]: cells of text, for a page and for a terminal.

use super::html::{escape, row, table};

/// A table; in a terminal its first column is aligned to the left, the others to the right.
pub(crate) struct Table {
    head: Vec<String>,
    rows: Vec<Vec<String>>,
}

impl Table {
    /// A table without rows.
    pub(crate) fn new<S: Into<String>>(head: impl IntoIterator<Item = S>) -> Table {
        Table { head: head.into_iter().map(Into::into).collect(), rows: Vec::new() }
    }

    /// The table with these rows below its own, each with a cell for each heading.
    pub(crate) fn with_rows(mut self, rows: impl IntoIterator<Item = Vec<String>>) -> Table {
        self.rows.extend(rows);
        self
    }

    pub(crate) fn is_empty(&self) -> bool {
        self.rows.is_empty()
    }

    pub(crate) fn html(&self) -> String {
        let line = |cell: &str, cells: &[String]| {
            let cells: Vec<String> = cells.iter().map(|cell| escape(cell)).collect();
            row(cell, &cells, "")
        };
        table(&(line("th", &self.head) + &self.rows.iter().map(|row| line("td", row)).collect::<String>()))
    }

    pub(crate) fn text(&self) -> String {
        let lines = || std::iter::once(&self.head).chain(&self.rows);
        let width = |column: usize| lines().map(|cells| cells[column].chars().count()).max().unwrap_or(0);
        let widths: Vec<usize> = (0..self.head.len()).map(width).collect();
        let line = |cells: &Vec<String>| {
            let padded: Vec<String> = cells
                .iter()
                .zip(&widths)
                .enumerate()
                .map(|(column, (cell, &width))| match column {
                    0 => format!("{cell:<width$}"),
                    _ => format!("{cell:>width$}"),
                })
                .collect();
            padded.join("  ").trim_end().to_owned() + "\n"
        };
        lines().map(line).collect()
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn columns_are_aligned_and_markup_is_escaped() {
        let row = |cells: [&str; 2]| cells.map(str::to_owned).to_vec();
        let table = Table::new(["name", "B"]).with_rows([row(["a<b", "10"]), row(["long name", "1,000"])]);
        assert_eq!(table.text(), "name           B\na<b           10\nlong name  1,000\n");
        assert!(table.html().contains("<tr><td>a&lt;b</td><td>10</td></tr>"), "{}", table.html());
        assert!(Table::new(["name"]).is_empty() && !table.is_empty());
    }
}

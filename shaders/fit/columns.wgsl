// The column layout of parameters, gradients and moments: one column after the other, each row after row.
// COUNT_* is the number of floats per row in a column, START_* the same in all columns before it.

// Index of the first float of `row`, in a column of `rows` rows.
fn place(rows: u32, start: u32, count: u32, row: u32) -> u32 {
    return rows * start + row * count;
}

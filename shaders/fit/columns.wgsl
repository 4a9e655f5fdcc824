// The columns of what is fitted, one after the other, each row after row. COUNT_* is how many numbers a
// row has in a column, START_* how many it has in those before.

// Where the numbers of a row begin in a column of `rows` rows.
fn place(rows: u32, start: u32, count: u32, row: u32) -> u32 {
    return rows * start + row * count;
}

//! The PLY container: header, and elements as tables of scalar columns.
//!
//! Reads all three encodings, and writes `binary_little_endian`. Counts in the header are checked against the bytes
//! that follow it before anything is allocated. Rows beyond the end of the file are reported as missing,
//! not as an error, so that the complete rows of a truncated file can be used. Elements that hold no Gaussians are
//! skipped, whatever they hold; a table knows which of its columns were not read.

use std::borrow::Cow;
use std::cell::Cell;
use std::cmp::Ordering;
use std::collections::BTreeMap;

use half::f16;

use crate::limits::ImportBudget;
use crate::statements::{Treatment, treatment};

/// Longest header that is searched for its end.
const HEADER_MAX: usize = 1 << 20;

/// The elements that are read: those of Gaussians.
const ELEMENTS: [&str; 3] = ["vertex", "chunk", "sh"];

/// What CloudCompare and 3dgsconverter put before the names of all properties but the centre.
const PREFIXES: [&str; 2] = ["scalar_", "scal_"];

/// A parsed header and the elements that follow it.
pub(super) struct Ply<'a> {
    /// Lines that start with `comment`, without that word. Their encoding is any: what is no UTF-8 is replaced.
    pub(super) comments: Vec<Cow<'a, str>>,
    tables: Vec<Table<'a>>,
}

/// The rows of an element.
pub(super) struct Table<'a> {
    name: &'a str,
    columns: Vec<Column<'a>>,
    /// Properties that are lists, each behind the columns of this number: the kinds of its length and of its items.
    lists: Vec<(usize, Kind, Kind)>,
    /// Positions of the columns by name, of the first where several have one name.
    positions: BTreeMap<Name<'a>, usize>,
    /// Rows that the header announces.
    announced: usize,
    /// Complete rows in the file.
    pub(super) rows: usize,
    cells: Cells<'a>,
}

struct Column<'a> {
    name: Name<'a>,
    kind: Kind,
    /// First byte within a binary row.
    offset: usize,
    /// Whether it was looked for by its name.
    is_read: Cell<bool>,
}

/// Name of a property. Unit tests count its comparisons, and so bound the work of finding properties.
#[derive(Clone, Copy)]
struct Name<'a>(&'a str);

impl Ord for Name<'_> {
    fn cmp(&self, other: &Self) -> Ordering {
        #[cfg(test)]
        tests::COMPARISONS.set(tests::COMPARISONS.get() + 1);
        self.0.cmp(other.0)
    }
}

impl PartialOrd for Name<'_> {
    fn partial_cmp(&self, other: &Self) -> Option<Ordering> {
        Some(self.cmp(other))
    }
}

impl PartialEq for Name<'_> {
    fn eq(&self, other: &Self) -> bool {
        self.cmp(other).is_eq()
    }
}

impl Eq for Name<'_> {}

/// The values of a table.
enum Cells<'a> {
    /// Rows of `stride` bytes.
    Binary { bytes: &'a [u8], stride: usize, order: Order },
    /// Parsed values, row-major.
    Ascii(Vec<f64>),
}

/// Order of the bytes of a number.
#[derive(Clone, Copy)]
enum Order {
    LittleEndian,
    BigEndian,
}

#[derive(Clone, Copy, PartialEq)]
enum Kind {
    I8,
    U8,
    I16,
    U16,
    I32,
    U32,
    I64,
    U64,
    F16,
    F32,
    F64,
}

impl Kind {
    fn parse(name: &str) -> Option<Kind> {
        Some(match name {
            "char" | "int8" => Kind::I8,
            "uchar" | "uint8" => Kind::U8,
            "short" | "int16" => Kind::I16,
            "ushort" | "uint16" => Kind::U16,
            "int" | "int32" => Kind::I32,
            "uint" | "uint32" => Kind::U32,
            // What few programs write, in elements of their own.
            "int64" => Kind::I64,
            "uint64" => Kind::U64,
            "half" | "float16" => Kind::F16,
            "float" | "float32" => Kind::F32,
            "double" | "float64" => Kind::F64,
            _ => return None,
        })
    }

    const fn size(self) -> usize {
        match self {
            Kind::I8 | Kind::U8 => 1,
            Kind::I16 | Kind::U16 | Kind::F16 => 2,
            Kind::I32 | Kind::U32 | Kind::F32 => 4,
            Kind::I64 | Kind::U64 | Kind::F64 => 8,
        }
    }

    /// The value at the start of `bytes`, which holds at least `size` bytes.
    fn read(self, bytes: &[u8], order: Order) -> f64 {
        fn first<const N: usize>(bytes: &[u8], order: Order) -> [u8; N] {
            std::array::from_fn(|i| match order {
                Order::LittleEndian => bytes[i],
                Order::BigEndian => bytes[N - 1 - i],
            })
        }
        match self {
            Kind::I8 => f64::from(bytes[0] as i8),
            Kind::U8 => f64::from(bytes[0]),
            Kind::I16 => f64::from(i16::from_le_bytes(first(bytes, order))),
            Kind::U16 => f64::from(u16::from_le_bytes(first(bytes, order))),
            Kind::I32 => f64::from(i32::from_le_bytes(first(bytes, order))),
            Kind::U32 => f64::from(u32::from_le_bytes(first(bytes, order))),
            Kind::I64 => i64::from_le_bytes(first(bytes, order)) as f64,
            Kind::U64 => u64::from_le_bytes(first(bytes, order)) as f64,
            Kind::F16 => f16::from_le_bytes(first(bytes, order)).to_f64(),
            Kind::F32 => f64::from(f32::from_le_bytes(first(bytes, order))),
            Kind::F64 => f64::from_le_bytes(first(bytes, order)),
        }
    }
}

impl<'a> Ply<'a> {
    /// Parses a file that starts with `ply`.
    ///
    /// # Errors
    /// One sentence: malformed header, unknown encoding, Gaussians with a list property, or beyond `budget`.
    pub(super) fn parse(bytes: &'a [u8], budget: &mut ImportBudget) -> Result<Ply<'a>, String> {
        let (header, mut body) = split_header(bytes)?;
        let mut ply = Ply { comments: Vec::new(), tables: Vec::new() };
        let mut encoding = None;
        for line in header.split(|&byte| byte == b'\n').skip(1).map(<[u8]>::trim_ascii) {
            if let Some(comment) = line.strip_prefix(b"comment") {
                ply.comments.push(String::from_utf8_lossy(comment.trim_ascii()));
                continue;
            }
            if line.starts_with(b"obj_info") {
                continue;
            }
            let line = std::str::from_utf8(line).map_err(|error| format!("PLY header: {error}"))?;
            let mut words = line.split_ascii_whitespace();
            match words.next() {
                Some("format") => {
                    encoding = Some(match words.next() {
                        Some("ascii") => None,
                        Some("binary_little_endian") => Some(Order::LittleEndian),
                        Some("binary_big_endian") => Some(Order::BigEndian),
                        other => {
                            return Err(format!(
                                "PLY format {} is not known; export it as binary_little_endian",
                                other.unwrap_or("?")
                            ));
                        }
                    });
                }
                Some("element") => ply.tables.push(element(line, words)?),
                Some("property") => {
                    let Some(table) = ply.tables.last_mut() else {
                        return Err(format!("PLY header: `{line}` stands before any element"));
                    };
                    table.push_property(line, words)?;
                }
                _ => {}
            }
        }
        let encoding = encoding.ok_or("PLY header without a format line")?;
        for table in &mut ply.tables {
            table.strip_prefixes();
            body = match (encoding, table.is_of_gaussians()) {
                (Some(order), true) => table.take_binary(body, order),
                (Some(order), false) => table.skip_binary(body, order),
                (None, true) => table.take_ascii(body, budget)?,
                (None, false) => table.skip_ascii(body),
            };
        }
        Ok(ply)
    }

    /// Names of the elements that have rows and of which no column was looked for.
    pub(super) fn unread_elements(&self) -> impl Iterator<Item = &str> {
        self.tables.iter().filter(|table| !table.is_read() && table.announced > 0).map(|table| table.name)
    }

    /// Names of the columns that were not looked for, of the other elements, in the order of the file.
    pub(super) fn unread_columns(&self) -> impl Iterator<Item = &str> {
        let columns = self.tables.iter().filter(|table| table.is_read()).flat_map(|table| &table.columns);
        columns.filter(|column| !column.is_read.get()).map(|column| column.name.0)
    }

    /// The element of this name.
    pub(super) fn table(&self, name: &str) -> Option<&Table<'a>> {
        self.tables.iter().find(|table| table.name == name)
    }
}

/// The lines of the header before its last, and the bytes behind it.
fn split_header(bytes: &[u8]) -> Result<(&[u8], &[u8]), String> {
    let mut start = 0;
    while start < bytes.len().min(HEADER_MAX) {
        let end = bytes[start..].iter().position(|&byte| byte == b'\n').map(|length| start + length);
        let Some(end) = end else { break };
        if bytes[start..end].trim_ascii() == b"end_header" {
            return Ok((&bytes[..start], &bytes[end + 1..]));
        }
        start = end + 1;
    }
    Err(format!("PLY header without end_header in the first {} bytes", bytes.len().min(HEADER_MAX)))
}

fn element<'a>(line: &str, mut words: impl Iterator<Item = &'a str>) -> Result<Table<'a>, String> {
    let (name, count) = (words.next(), words.next().and_then(|word| word.parse::<usize>().ok()));
    let (Some(name), Some(announced)) = (name, count) else {
        return Err(format!("PLY header: cannot read `{line}`"));
    };
    let (columns, lists, positions) = (Vec::new(), Vec::new(), BTreeMap::new());
    Ok(Table { name, columns, lists, positions, announced, rows: 0, cells: Cells::Ascii(Vec::new()) })
}

impl<'a> Table<'a> {
    /// Whether a column of it was looked for by its name.
    fn is_read(&self) -> bool {
        self.columns.iter().any(|column| column.is_read.get())
    }

    /// Whether its rows are parsed.
    fn is_of_gaussians(&self) -> bool {
        ELEMENTS.contains(&self.name)
    }

    fn push_property(&mut self, line: &str, mut words: impl Iterator<Item = &'a str>) -> Result<(), String> {
        let mut next_kind = || Kind::parse(words.next()?);
        let wrong = || format!("PLY header: cannot read `{line}`");
        if line.split_ascii_whitespace().nth(1) == Some("list") {
            if self.is_of_gaussians() {
                return Err(format!(
                    "PLY element {} has a list property, which no field has; export Gaussians",
                    self.name
                ));
            }
            next_kind();
            let (length, item) = (next_kind().ok_or_else(wrong)?, next_kind().ok_or_else(wrong)?);
            self.lists.push((self.columns.len(), length, item));
            return Ok(());
        }
        let kind = next_kind().ok_or_else(wrong)?;
        let name = words.next().ok_or_else(wrong)?;
        let offset = self.stride();
        self.positions.entry(Name(name)).or_insert(self.columns.len());
        self.columns.push(Column { name: Name(name), kind, offset, is_read: Cell::new(false) });
        Ok(())
    }

    /// Names properties without [`PREFIXES`] where the colours of Gaussians have one.
    fn strip_prefixes(&mut self) {
        const COLOR: &str = "f_dc_0";
        let stripped = |name: &'a str| PREFIXES.iter().find_map(|prefix| name.strip_prefix(prefix));
        if self.has(COLOR) || !self.columns.iter().any(|column| stripped(column.name.0) == Some(COLOR)) {
            return;
        }
        for (i, column) in self.columns.iter_mut().enumerate() {
            // A property that has the name already keeps it.
            if let Some(name) = stripped(column.name.0)
                && *self.positions.entry(Name(name)).or_insert(i) == i
            {
                column.name = Name(name);
            }
        }
    }

    /// Bytes of a binary row without its lists.
    fn stride(&self) -> usize {
        self.columns.last().map_or(0, |column| column.offset + column.kind.size())
    }

    /// Takes the whole rows that are there off the front of `body`.
    fn take_binary(&mut self, body: &'a [u8], order: Order) -> &'a [u8] {
        let stride = self.stride();
        self.rows = self.announced.min(body.len().checked_div(stride).unwrap_or(0));
        // After a truncated element the offsets of later elements are unknown.
        let rest = if self.rows == self.announced { self.rows * stride } else { body.len() };
        self.cells = Cells::Binary { bytes: &body[..self.rows * stride], stride, order };
        &body[rest..]
    }

    /// The bytes behind the rows of an element that is not read; none where it does not end.
    fn skip_binary(&self, body: &'a [u8], order: Order) -> &'a [u8] {
        let skipped = |size: usize| body.get(size..);
        if self.lists.is_empty() {
            return self.announced.checked_mul(self.stride()).and_then(skipped).unwrap_or_default();
        }
        let mut rest = body;
        // Each row takes bytes: a list has its length.
        for _ in 0..self.announced {
            let Some(after) = self.skip_row(rest, order) else { return &[] };
            rest = after;
        }
        rest
    }

    /// The bytes behind a row with lists; `None` if the row does not end.
    fn skip_row(&self, mut rest: &'a [u8], order: Order) -> Option<&'a [u8]> {
        let start_of = |column: usize| self.columns.get(column).map_or(self.stride(), |column| column.offset);
        let mut done = 0;
        for &(before, length, item) in &self.lists {
            rest = rest.get(start_of(before) - done..)?;
            done = start_of(before);
            let count = rest.get(..length.size()).map(|bytes| length.read(bytes, order))?;
            rest = rest.get((count as usize).checked_mul(item.size())?.checked_add(length.size())?..)?;
        }
        rest.get(self.stride() - done..)
    }

    /// The bytes behind the rows of an element that is not read.
    fn skip_ascii(&self, mut body: &'a [u8]) -> &'a [u8] {
        let mut rows = 0;
        while rows < self.announced && !body.is_empty() {
            rows += usize::from(!take_line(&mut body).is_empty());
        }
        body
    }

    /// Takes the whole rows that are there off the front of `body`, one per line that is not blank.
    fn take_ascii(&mut self, mut body: &'a [u8], budget: &mut ImportBudget) -> Result<&'a [u8], String> {
        // A number takes a digit and a separator or the end of the file.
        let rows_max = (body.len() + 1) / (2 * self.columns.len()).max(1);
        let mut values = budget.vec(self.announced.min(rows_max) * self.columns.len())?;
        while self.rows < self.announced && !body.is_empty() {
            let line = take_line(&mut body);
            if line.is_empty() {
                continue;
            }
            let mut words = line.split(u8::is_ascii_whitespace).filter(|word| !word.is_empty());
            for column in &self.columns {
                let value = words.next().and_then(parse_number).ok_or_else(|| {
                    format!("PLY element {}, row {}: no number for {}", self.name, self.rows, column.name.0)
                })?;
                values.push(value);
            }
            self.rows += 1;
        }
        self.cells = Cells::Ascii(values);
        Ok(body)
    }

    /// Rows that the header announces and the file lacks.
    pub(super) fn missing_rows(&self) -> usize {
        self.announced - self.rows
    }

    /// Whether there is a property of this name.
    pub(super) fn has(&self, name: &str) -> bool {
        self.positions.contains_key(&Name(name))
    }

    /// The value of a column of full brightness: the largest of an unsigned integer, otherwise 1.
    pub(super) fn white(&self, column: usize) -> f64 {
        match self.columns[column].kind {
            Kind::U8 => f64::from(u8::MAX),
            Kind::U16 => f64::from(u16::MAX),
            _ => 1.0,
        }
    }

    /// Number of the properties `prefix0`, `prefix1`, ... up to the first gap.
    pub(super) fn count_numbered(&self, prefix: &str) -> usize {
        (0..self.columns.len()).take_while(|i| self.has(&format!("{prefix}{i}"))).count()
    }

    /// Positions of the named properties, to be given to [`Table::get`].
    ///
    /// # Errors
    /// One sentence that names all properties that are missing.
    pub(super) fn find<S: AsRef<str>, const N: usize>(&self, names: [S; N]) -> Result<[usize; N], String> {
        let found = names.each_ref().map(|name| self.positions.get(&Name(name.as_ref())).copied());
        for column in found.iter().flatten().map(|&column| &self.columns[column]) {
            debug_assert_eq!(
                treatment(super::statements::STATEMENTS, column.name.0),
                Treatment::Honoured,
                "{} is read and not declared",
                column.name.0
            );
            column.is_read.set(true);
        }
        let missing: Vec<&str> = names
            .iter()
            .zip(&found)
            .filter(|(_, place)| place.is_none())
            .map(|(name, _)| name.as_ref())
            .collect();
        if missing.is_empty() {
            Ok(found.map(|place| place.expect("none is missing")))
        } else {
            let (element, missing) = (self.name, missing.join(", "));
            Err(format!(
                "PLY element {element} lacks the properties {missing}; a mesh or a cloud of points is no field, export \
                 Gaussians"
            ))
        }
    }

    /// The value in `row` of the property at position `column`, with the precision of its kind, so that all encodings
    /// of a file read the same.
    ///
    /// # Panics
    /// If either is out of range.
    pub(super) fn get(&self, row: usize, column: usize) -> f64 {
        let exact = self.exact(row, column);
        match self.columns[column].kind {
            Kind::F16 => f16::from_f64(exact).to_f64(),
            Kind::F32 => f64::from(exact as f32),
            _ => exact,
        }
    }

    /// As [`Table::get`], with all digits that a text has.
    pub(super) fn exact(&self, row: usize, column: usize) -> f64 {
        match &self.cells {
            Cells::Binary { bytes, stride, order } => {
                let column = &self.columns[column];
                column.kind.read(&bytes[row * stride + column.offset..], *order)
            }
            Cells::Ascii(values) => values[row * self.columns.len() + column],
        }
    }

    /// The values in `row` of the properties at the given positions, as `f32`.
    pub(super) fn row<const N: usize>(&self, row: usize, columns: [usize; N]) -> [f32; N] {
        columns.map(|column| self.get(row, column) as f32)
    }
}

/// Takes a line off the front of `body`, without white space around it.
fn take_line<'a>(body: &mut &'a [u8]) -> &'a [u8] {
    let end = body.iter().position(|&byte| byte == b'\n').unwrap_or(body.len());
    let line = body[..end].trim_ascii();
    *body = &body[body.len().min(end + 1)..];
    line
}

/// Parses a number, and what C libraries print for one that is none: `nan(ind)`, `1.#QNAN`, `1.#INF`.
fn parse_number(word: &[u8]) -> Option<f64> {
    let word = std::str::from_utf8(word).ok()?;
    word.parse().ok().or_else(|| {
        let unsigned = word.trim_start_matches(['-', '+']).to_ascii_lowercase();
        if unsigned.starts_with("1.#inf") {
            return Some(if word.starts_with('-') { f64::NEG_INFINITY } else { f64::INFINITY });
        }
        (unsigned.starts_with("nan") || unsigned.starts_with("1.#")).then_some(f64::NAN)
    })
}

/// A little-endian PLY with one `vertex` element of `float` properties; `push_row` appends the
/// values of a row.
pub(super) fn write(
    comments: &[String],
    names: &[String],
    rows: usize,
    mut push_row: impl FnMut(usize, &mut Vec<f32>),
) -> Vec<u8> {
    let mut header = String::from("ply\nformat binary_little_endian 1.0\n");
    comments.iter().for_each(|comment| header += &format!("comment {comment}\n"));
    header += &format!("element vertex {rows}\n");
    names.iter().for_each(|name| header += &format!("property float {name}\n"));
    header += "end_header\n";

    let mut bytes = header.into_bytes();
    bytes.reserve(4 * rows * names.len());
    let mut row = Vec::with_capacity(names.len());
    for i in 0..rows {
        row.clear();
        push_row(i, &mut row);
        debug_assert_eq!(row.len(), names.len(), "one value per property");
        bytes.extend(row.iter().flat_map(|value| value.to_le_bytes()));
    }
    bytes
}

#[cfg(test)]
mod tests {
    use std::cell::Cell;

    use super::*;
    use crate::limits::ImportLimits;
    use crate::ply::gaussian_splatting;

    thread_local! {
        /// Comparisons of names on this thread.
        pub(crate) static COMPARISONS: Cell<usize> = const { Cell::new(0) };
    }

    #[test]
    fn many_properties_are_no_more_work_each_than_few() {
        let comparisons = |count: usize| {
            COMPARISONS.set(0);
            let names = "x y z f_dc_0 f_dc_1 f_dc_2 opacity scale_0 scale_1 scale_2 rot_0 rot_1 rot_2 rot_3";
            let numbered: String = (0..count).map(|k| format!("property char f_rest_{k}\n")).collect();
            let named: String = names.split(' ').map(|name| format!("property float {name}\n")).collect();
            let text = format!("ply\nformat ascii 1.0\nelement vertex 0\n{numbered}{named}end_header\n");
            let mut budget = ImportBudget::new(ImportLimits::default());
            let ply = Ply::parse(text.as_bytes(), &mut budget).unwrap();
            let message = gaussian_splatting::read(ply.table("vertex").unwrap(), &mut budget).unwrap_err();
            assert!(message.contains(&format!("{count} properties f_rest_*")), "{message}");
            COMPARISONS.get()
        };
        let (few, many) = (comparisons(4_750), comparisons(38_000));
        assert!(0 < few && many < 16 * few, "eight times the properties take {many} comparisons, not {few}");
    }
}

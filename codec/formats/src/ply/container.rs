//! The PLY container: header, and elements as tables of scalar columns.
//!
//! Reads `binary_little_endian` and `ascii`, and writes the former. Counts in the header are checked against the bytes
//! that follow it before anything is allocated. Rows beyond the end of the file are reported as missing,
//! not as an error, so that the complete rows of a truncated file can be used.

use std::cmp::Ordering;
use std::collections::BTreeMap;

use crate::limits::ImportBudget;

/// Longest header that is searched for its end.
const HEADER_MAX: usize = 1 << 20;

/// A parsed header and the elements that follow it.
pub(super) struct Ply<'a> {
    /// Lines that start with `comment`, without that word.
    pub(super) comments: Vec<&'a str>,
    tables: Vec<Table<'a>>,
}

/// The rows of an element.
pub(super) struct Table<'a> {
    name: &'a str,
    columns: Vec<Column<'a>>,
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
    Binary { bytes: &'a [u8], stride: usize },
    /// Parsed values, row-major.
    Ascii(Vec<f64>),
}

#[derive(Clone, Copy, PartialEq)]
enum Kind {
    I8,
    U8,
    I16,
    U16,
    I32,
    U32,
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
            "float" | "float32" => Kind::F32,
            "double" | "float64" => Kind::F64,
            _ => return None,
        })
    }

    const fn size(self) -> usize {
        match self {
            Kind::I8 | Kind::U8 => 1,
            Kind::I16 | Kind::U16 => 2,
            Kind::I32 | Kind::U32 | Kind::F32 => 4,
            Kind::F64 => 8,
        }
    }

    /// The value at the start of `bytes`, which holds at least `size` bytes.
    fn read(self, bytes: &[u8]) -> f64 {
        fn first<const N: usize>(bytes: &[u8]) -> [u8; N] {
            std::array::from_fn(|i| bytes[i])
        }
        match self {
            Kind::I8 => f64::from(bytes[0] as i8),
            Kind::U8 => f64::from(bytes[0]),
            Kind::I16 => f64::from(i16::from_le_bytes(first(bytes))),
            Kind::U16 => f64::from(u16::from_le_bytes(first(bytes))),
            Kind::I32 => f64::from(i32::from_le_bytes(first(bytes))),
            Kind::U32 => f64::from(u32::from_le_bytes(first(bytes))),
            Kind::F32 => f64::from(f32::from_le_bytes(first(bytes))),
            Kind::F64 => f64::from_le_bytes(first(bytes)),
        }
    }
}

impl<'a> Ply<'a> {
    /// Parses a file that starts with `ply`.
    ///
    /// # Errors
    /// One sentence: malformed header, unsupported encoding or list property, or beyond `budget`.
    pub(super) fn parse(bytes: &'a [u8], budget: &mut ImportBudget) -> Result<Ply<'a>, String> {
        let (header, body_start) = split_header(bytes)?;
        let mut ply = Ply { comments: Vec::new(), tables: Vec::new() };
        let mut ascii = None;
        for line in header.lines().skip(1) {
            let mut words = line.split_ascii_whitespace();
            match words.next() {
                Some("format") => {
                    ascii = Some(match words.next() {
                        Some("ascii") => true,
                        Some("binary_little_endian") => false,
                        other => return Err(format!("PLY format {} is not supported", other.unwrap_or("?"))),
                    });
                }
                Some("comment") => ply.comments.push(line.trim_start()["comment".len()..].trim()),
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
        let mut body = &bytes[body_start..];
        match ascii {
            None => return Err("PLY header without a format line".into()),
            Some(true) => {
                for table in &mut ply.tables {
                    body = table.take_ascii(body, budget)?;
                }
            }
            Some(false) => {
                for table in &mut ply.tables {
                    body = table.take_binary(body);
                }
            }
        }
        Ok(ply)
    }

    /// The element of this name.
    pub(super) fn table(&self, name: &str) -> Option<&Table<'a>> {
        self.tables.iter().find(|table| table.name == name)
    }
}

/// The header as text and the offset of the first byte after it.
fn split_header(bytes: &[u8]) -> Result<(&str, usize), String> {
    let mut start = 0;
    while start < bytes.len().min(HEADER_MAX) {
        let end = bytes[start..].iter().position(|&byte| byte == b'\n').map(|length| start + length);
        let Some(end) = end else { break };
        if bytes[start..end].trim_ascii() == b"end_header" {
            let text = std::str::from_utf8(&bytes[..start]).map_err(|e| format!("PLY header: {e}"))?;
            return Ok((text, end + 1));
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
    let cells = Cells::Binary { bytes: &[], stride: 0 };
    Ok(Table { name, columns: Vec::new(), positions: BTreeMap::new(), announced, rows: 0, cells })
}

impl<'a> Table<'a> {
    fn push_property(&mut self, line: &str, mut words: impl Iterator<Item = &'a str>) -> Result<(), String> {
        let kind = words.next().unwrap_or_default();
        if kind == "list" {
            return Err(format!("PLY element {} has a list property, which no field has", self.name));
        }
        let (Some(kind), Some(name)) = (Kind::parse(kind), words.next()) else {
            return Err(format!("PLY header: cannot read `{line}`"));
        };
        let offset = self.columns.last().map_or(0, |column| column.offset + column.kind.size());
        self.positions.entry(Name(name)).or_insert(self.columns.len());
        self.columns.push(Column { name: Name(name), kind, offset });
        Ok(())
    }

    /// Takes the whole rows that are there off the front of `body`.
    fn take_binary(&mut self, body: &'a [u8]) -> &'a [u8] {
        let stride = self.columns.last().map_or(0, |column| column.offset + column.kind.size());
        self.rows = self.announced.min(body.len().checked_div(stride).unwrap_or(0));
        // After a truncated element the offsets of later elements are unknown.
        let rest = if self.rows == self.announced { self.rows * stride } else { body.len() };
        self.cells = Cells::Binary { bytes: &body[..self.rows * stride], stride };
        &body[rest..]
    }

    /// Takes the whole rows that are there off the front of `body`, one per line that is not blank.
    fn take_ascii(&mut self, mut body: &'a [u8], budget: &mut ImportBudget) -> Result<&'a [u8], String> {
        // A number takes a digit and a separator or the end of the file.
        let rows_max = (body.len() + 1) / (2 * self.columns.len()).max(1);
        let mut values = budget.vec(self.announced.min(rows_max) * self.columns.len())?;
        while self.rows < self.announced && !body.is_empty() {
            let end = body.iter().position(|&byte| byte == b'\n').unwrap_or(body.len());
            let line = body[..end].trim_ascii();
            body = &body[body.len().min(end + 1)..];
            if line.is_empty() {
                continue;
            }
            let mut words = line.split(u8::is_ascii_whitespace).filter(|word| !word.is_empty());
            for column in &self.columns {
                let value =
                    words.next().and_then(|word| parse_number(word, column.kind)).ok_or_else(|| {
                        format!(
                            "PLY element {}, row {}: no number for {}",
                            self.name, self.rows, column.name.0
                        )
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
        let missing: Vec<&str> = names
            .iter()
            .zip(&found)
            .filter(|(_, place)| place.is_none())
            .map(|(name, _)| name.as_ref())
            .collect();
        if missing.is_empty() {
            Ok(found.map(|place| place.expect("none is missing")))
        } else {
            Err(format!("PLY element {} lacks the properties {}", self.name, missing.join(", ")))
        }
    }

    /// The value in `row` of the property at position `column`.
    ///
    /// # Panics
    /// If either is out of range.
    pub(super) fn get(&self, row: usize, column: usize) -> f64 {
        match &self.cells {
            Cells::Binary { bytes, stride } => {
                let column = &self.columns[column];
                column.kind.read(&bytes[row * stride + column.offset..])
            }
            Cells::Ascii(values) => values[row * self.columns.len() + column],
        }
    }

    /// The values in `row` of the properties at the given positions, as `f32`.
    pub(super) fn row<const N: usize>(&self, row: usize, columns: [usize; N]) -> [f32; N] {
        columns.map(|column| self.get(row, column) as f32)
    }
}

/// Parses a number with the precision of its binary form, so that both forms of a file read the same.
fn parse_number(word: &[u8], kind: Kind) -> Option<f64> {
    let word = std::str::from_utf8(word).ok()?;
    if kind == Kind::F32 { word.parse::<f32>().ok().map(f64::from) } else { word.parse().ok() }
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

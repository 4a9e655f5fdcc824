//! PLY: [`read`] finds out which program's columns a file has.
//!
//! `container` reads and writes header and tables, `comments` the metadata of a clip in the header's comments. The other
//! files each have one set of columns. Written are the columns of 3D Gaussian Splatting and this project's field file.

mod comments;
mod compressed;
mod container;
mod field_file;
mod four_dimensional;
mod freetime;
mod gaussian_splatting;
mod spacetime;
mod statements;

use crate::imported::{Hints, Imported};
use crate::limits::ImportBudget;
use crate::statements::unread;

use container::Ply;

pub use comments::{MARK, VERSION as FIELD_FILE_VERSION};
pub use field_file::{write_commented_field_file, write_field_file};
pub(crate) use gaussian_splatting::lost;
pub use gaussian_splatting::write_static_ply;
pub(crate) use statements::STATEMENTS;

/// The first bytes of a file.
pub(crate) const STARTS: [&[u8]; 2] = [b"ply\n", b"ply\r"];

/// Reads the rows of a field.
pub(crate) fn read(bytes: &[u8], budget: &mut ImportBudget) -> Result<Imported, String> {
    let ply = &Ply::parse(bytes, budget)?;
    let Some(vertex) = ply.table("vertex") else {
        return Err("PLY without a vertex element".into());
    };
    let (hints, filter) = (comments::hints(ply)?, comments::filter(ply)?);
    let mut imported = if comments::is_marked(ply) {
        field_file::read(vertex, budget)
    } else if ply.table("chunk").is_some() {
        compressed::read(ply, vertex, budget)
    } else if vertex.has("trbf_center") {
        spacetime::read(vertex, budget)
    } else if four_dimensional::is_one(vertex) {
        four_dimensional::read(vertex, budget)
    } else if freetime::is_one(vertex) {
        freetime::read(vertex, budget)
    } else {
        gaussian_splatting::read(vertex, budget)
    }?;
    let Imported { field, account, .. } = &mut imported;
    field.filter = filter.filter;
    account.assumed.extend(filter.assumed);
    account.lost.extend(comments::unread(ply));
    if let Some(names) = unread(STATEMENTS, ply.unread_columns()) {
        let instants = "; where they move or fade Gaussians, all instants are shown at once";
        let instants = if field.temporal.is_none() { instants } else { "" };
        account.lost.push(format!("columns that are not read: {names}{instants}"));
    }
    let elements = unread(&[], ply.unread_elements());
    account.lost.extend(elements.map(|names| format!("elements that are not read: {names}")));
    let read = imported.hints;
    imported.hints = Hints { origin: read.origin, duration_s: hints.duration_s.or(read.duration_s), ..hints };
    if comments::is_marked(ply) {
        // A field file is complete: where it states no near distance, it has none.
        imported.hints.near.get_or_insert(0.0);
    }
    Ok(imported)
}

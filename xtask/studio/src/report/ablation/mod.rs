//! The ablation of a fit (the paper's tables): fits with one part left out each, other methods by their pictures, all
//! splits, and packages of every fit.
//!
//! ```text
//! capture -> variant -> fit -> eval -> packages -> eval -\
//! other methods' pictures ----------> eval ---------------> Ablation -> page, JSON
//! ```

mod part;
mod result;
mod table;
mod variant;

pub use result::{Ablation, FieldFigures, LeftOut, Method, PackageFigures, Picture, PicturedView};
pub use variant::{FullFit, VARIANTS, Variant};

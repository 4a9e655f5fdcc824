//! [`Discs`]: the visible rows of fields as discs, at a few instants.
//!
//! A disc has the opacity of its Gaussian and as much opacity times area as the Gaussian has from its broad side. Of
//! many rows a regular selection stands for all, each disc for several rows.

use crate::{ALPHA_MIN, Field};

/// Instants at which a dynamic field is looked at: the centres of so many equal intervals.
const INSTANTS: usize = 4;

/// A disc is wide from this area on, in pixels of a picture that the content fills.
const WIDE_AREA: f64 = 16.0;

/// Area of the wide discs of an instant, in the same unit, from which on fewer stand for them: the time that a picture takes.
const WIDE_AREA_SUM_MAX: f64 = 400_000.0;

/// Least opacity of a disc that stands for several wide ones.
const WIDE_OPACITY_MIN: f64 = 0.2;

/// Largest absolute logarithm of a scale: numbers of any field stay finite.
const LOG_SCALE_MAX: f64 = 80.0;

/// A row at an instant.
#[derive(Clone, Copy, Debug)]
pub(super) struct Disc {
    /// In source units.
    pub(super) center: [f64; 3],
    /// In source units, above 0.
    pub(super) radius: f64,
    /// Opacity at the instant, [`ALPHA_MIN`] to 1.
    pub(super) opacity: f64,
    /// Index of the selected row, the same at all instants. The plate's rows come after the field's.
    pub(super) row: usize,
    /// Whether it belongs to what people look at.
    pub(super) is_content: bool,
}

/// Discs at each instant.
#[derive(Clone, Debug)]
pub(super) struct Discs {
    /// Never empty. An instant may have no discs.
    pub(super) instants: Vec<Vec<Disc>>,
    /// Number of selected rows of the fields.
    pub(super) field_rows: usize,
    /// Number of selected rows of the fields and the plate.
    pub(super) rows: usize,
    /// The largest [`Field::near`].
    pub(super) near: f64,
}

/// Makes [`Discs`] of fields that need not be in memory at once.
#[derive(Clone, Debug)]
pub(super) struct DiscsBuilder {
    /// Rows of all fields.
    all: usize,
    /// Most rows to select.
    most: usize,
    instants: [Vec<Disc>; INSTANTS],
    /// All rows where their opacity peaks, until an instant has a disc.
    peaks: Vec<Disc>,
    is_dynamic: bool,
    plate: Option<Vec<Disc>>,
    /// Selected rows up to now.
    field_rows: usize,
    near: f64,
}

impl DiscsBuilder {
    /// Selects at most `most` rows of fields that have `all` rows together, and as many of their static background.
    pub(super) fn new(all: usize, most: usize) -> DiscsBuilder {
        DiscsBuilder {
            all,
            most,
            instants: Default::default(),
            peaks: Vec::new(),
            is_dynamic: false,
            plate: None,
            field_rows: 0,
            near: 0.0,
        }
    }

    /// Adds a field that is looked at in a range of its clip time.
    pub(super) fn add(&mut self, field: &Field, [from, to]: [f64; 2]) {
        let count = match self.all <= self.most {
            true => field.len(),
            // A small field among many large ones is looked at, too.
            false => {
                ((field.len() as f64 * self.most as f64 / self.all as f64) as usize).max(field.len().min(1))
            }
        };
        let first = self.field_rows;
        for (instant, discs) in self.instants.iter_mut().enumerate() {
            let share = (instant as f64 + 0.5) / INSTANTS as f64;
            discs.extend(discs_at(field, Some(from + share * (to - from)), count, first));
        }
        if self.instants.iter().all(Vec::is_empty) {
            self.peaks.extend(discs_at(field, None, count, first));
        }
        self.is_dynamic |= !field.is_empty() && field.temporal.is_some();
        self.field_rows += count;
        self.near = self.near.max(f64::from(field.near));
    }

    /// Adds the static background; the first one counts.
    pub(super) fn add_plate(&mut self, plate: &Field) {
        let most = self.most;
        self.plate.get_or_insert_with(|| discs_at(plate, Some(0.0), most, 0).collect());
    }

    /// The discs. Rows that live at no instant have none; if no row has any, all rows are opaque discs where their opacity
    /// peaks.
    pub(super) fn build(self) -> Discs {
        let DiscsBuilder { instants, peaks, is_dynamic, plate, field_rows, near, .. } = self;
        let mut instants = if instants.iter().all(Vec::is_empty) { vec![peaks] } else { Vec::from(instants) };
        if !is_dynamic {
            instants.truncate(1);
        }
        let plate = plate.unwrap_or_default();
        let rows = field_rows + plate.iter().map(|disc| disc.row + 1).max().unwrap_or(0);
        for discs in &mut instants {
            discs.extend(plate.iter().map(|disc| Disc { row: field_rows + disc.row, ..*disc }));
        }
        Discs { instants, field_rows, rows, near }
    }
}

impl Discs {
    /// The discs of a field at clip time `t`, and of its static background: of at most `most` rows of either.
    pub(super) fn at(field: &Field, plate: Option<&Field>, t: f64, most: usize) -> Discs {
        let field_rows = field.len().min(most);
        let of_plate = plate.into_iter().flat_map(|plate| discs_at(plate, Some(0.0), most, field_rows));
        let instant = discs_at(field, Some(t), most, 0).chain(of_plate).collect();
        let rows = field_rows + plate.map_or(0, |plate| plate.len().min(most));
        Discs { instants: vec![instant], field_rows, rows, near: f64::from(field.near) }
    }

    /// Lets one stand for several wide, translucent discs where many would take long to draw: it has their sum of opacities.
    /// They are wide in pictures of `size` pixels that a ball of this `radius` fills, in source units.
    pub(super) fn thin_out(&mut self, radius: f64, size: (u32, u32)) {
        let pixel = 2.0 * radius / f64::from(size.1);
        let area = |disc: &Disc| std::f64::consts::PI * (disc.radius / pixel).powi(2);
        let is_wide = |disc: &Disc| area(disc) >= WIDE_AREA;
        let picture = f64::from(size.0 * size.1);
        for discs in &mut self.instants {
            let sum: f64 =
                discs.iter().filter(|disc| is_wide(disc)).map(|disc| area(disc).min(picture)).sum();
            if sum <= WIDE_AREA_SUM_MAX {
                continue;
            }
            let mut opacity = 0.0;
            discs.retain_mut(|disc| {
                if !is_wide(disc) {
                    return true;
                }
                opacity += disc.opacity;
                let is_left = opacity >= WIDE_OPACITY_MIN;
                if is_left {
                    disc.opacity = f64::min(opacity, 1.0);
                    opacity = 0.0;
                }
                is_left
            });
        }
    }
}

/// The discs of a part at clip time `t`, or of all of its rows where their opacity peaks. Rows are counted from `first`.
fn discs_at(field: &Field, t: Option<f64>, most: usize, first: usize) -> impl Iterator<Item = Disc> {
    let count = field.len().min(most);
    let rows_of_disc = field.len() as f64 / count.max(1) as f64;
    let disc = move |i: usize| {
        let row = (i as f64 * rows_of_disc) as usize;
        let (center, opacity) = match t {
            Some(t) => (field.position_at(row, t), field.opacity_at(row, t)),
            None => (field.centers[row].map(f64::from), 1.0),
        };
        let mut logs = field.log_scales[row].map(|log| f64::from(log).clamp(-LOG_SCALE_MAX, LOG_SCALE_MAX));
        logs.sort_by(f64::total_cmp);
        // The integral of a Gaussian's opacity over its broad side is 2 pi s1 s2 o.
        let radius = (2.0 * rows_of_disc).sqrt() * libm::exp(0.5 * (logs[1] + logs[2]));
        let is_seen = opacity >= ALPHA_MIN && center.iter().all(|x| x.is_finite());
        is_seen.then_some(Disc { center, radius, opacity, row: first + i, is_content: false })
    };
    (0..count).filter_map(disc)
}

//! [`Agreement`]: what all segments of a take have in common.

use codec::{ClipInfo, Field, PixelFilter};
use program::Fault;

use crate::fields::FitRecord;

/// Largest difference of a coordinate of two up axes that are the same.
const UP_TOLERANCE: f32 = 1e-4;

/// Axes, scale, origins and filters of the segments seen so far.
#[derive(Debug, Default)]
pub(crate) struct Agreement {
    /// The first segment and its axes, scale and filter.
    first: Option<(String, [f32; 3], f32, PixelFilter)>,
    /// The first segment that records its origin, and the point of the capture's world that it is at.
    origin: Option<(String, [f64; 3])>,
    /// The first segment with a plate, and the filter of that.
    plate: Option<(String, PixelFilter)>,
}

impl Agreement {
    /// Compares a segment with the segments before it.
    ///
    /// # Errors
    /// [`Fault::Data`] that names both and what differs.
    pub(crate) fn add(
        &mut self,
        name: &str,
        info: &ClipInfo,
        record: &FitRecord,
        field: &Field,
        plate: Option<&Field>,
    ) -> Result<(), Fault> {
        let (up, scale, filter) = (info.up, info.metres_per_unit, field.filter);
        let (first, first_up, first_scale, first_filter) =
            self.first.get_or_insert_with(|| (name.to_owned(), up, scale, filter));
        if up.iter().zip(&*first_up).any(|(a, b)| (a - b).abs() > UP_TOLERANCE) {
            return Err(Fault::Data(format!(
                "{name}: up is {up:?}, and {first_up:?} in {first}; a take has one, set it in a scene.json"
            )));
        }
        if scale != *first_scale {
            return Err(Fault::Data(format!(
                "{name}: {scale} metres per unit, and {first_scale} in {first}; a take has one scale, set it in a scene.json"
            )));
        }
        if let Some(origin) = record.recorded_origin() {
            let (first, first_origin) = self.origin.get_or_insert_with(|| (name.to_owned(), origin));
            if origin != *first_origin {
                let [point, first_point] = [origin, *first_origin].map(|[x, y, z]| format!("{x} {y} {z}"));
                return Err(Fault::Data(format!(
                    "{name}: it is about {point} of the world of its capture, and {first} about {first_point}; a take has one \
                     origin, so fit both to one capture, with all its cameras"
                )));
            }
        }
        if filter != *first_filter {
            return Err(other_filter(name, filter, first, *first_filter));
        }
        if let Some(plate) = plate {
            let (first, filter) = self.plate.get_or_insert_with(|| (name.to_owned(), plate.filter));
            if plate.filter != *filter {
                return Err(other_filter(&format!("the plate of {name}"), plate.filter, first, *filter));
            }
        }
        Ok(())
    }
}

fn other_filter(name: &str, filter: PixelFilter, first: &str, first_filter: PixelFilter) -> Fault {
    Fault::Data(format!(
        "{name}: its filter is {}, and {} in {first}; a take has one, fit both with the same",
        filter.name(),
        first_filter.name()
    ))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn segments_about_different_origins_are_refused() {
        let mut agreement = Agreement::default();
        let mut add = |name: &str, frames: Option<std::ops::Range<usize>>, origin: Option<[f64; 3]>| {
            let record = FitRecord { frames, origin, ..FitRecord::default() };
            agreement.add(name, &ClipInfo::default(), &record, &Field::default(), None)
        };
        let far = Some([500_000.0, 4_100_001.0, -20.0]);
        add("package", None, None).unwrap();
        add("a.ply", Some(0..9), far).unwrap();
        add("b.ply", Some(9..18), far).unwrap();
        for origin in [None, Some([500_000.0, 4_100_000.0, -20.0])] {
            let error = add("c.ply", Some(0..9), origin).unwrap_err().to_string();
            assert!(
                error.starts_with("c.ply: it is about ") && error.contains("and a.ply about 500000"),
                "{error}"
            );
        }
        add("theirs.ply", None, None).unwrap();
    }
}

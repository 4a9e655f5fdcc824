//! [`Columns`]: which columns the Gaussians of a region have.

use crate::{Error, Field, PixelFilter, Region, Temporal, limits::Budget, sh_coefficients};
#[cfg(feature = "encode")]
use crate::{MOTION_ORDER_MAX, SH_DEGREE_MAX};

/// Which columns the Gaussians of a region have.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub(crate) struct Columns {
    pub(crate) sh_degree: u8,
    pub(crate) temporal: Option<TemporalColumns>,
}

/// Which of the optional temporal columns Gaussians have; tau and s are always there.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub(crate) struct TemporalColumns {
    pub(crate) motion_order: u8,
    pub(crate) rotation_rates: bool,
}

/// Which columns each region of a package has.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub(crate) struct PackageColumns {
    /// SH degree in the static and the dynamic region.
    pub(crate) sh_degree: u8,
    /// Temporal columns of the dynamic region.
    pub(crate) temporal: TemporalColumns,
    pub(crate) plate_sh_degree: u8,
}

impl PackageColumns {
    /// The columns of a region.
    pub(crate) fn in_region(self, region: Region) -> Columns {
        match region {
            Region::Static => Columns { sh_degree: self.sh_degree, temporal: None },
            Region::Plate => Columns { sh_degree: self.plate_sh_degree, temporal: None },
            Region::Dynamic => Columns { sh_degree: self.sh_degree, temporal: Some(self.temporal) },
        }
    }

    /// The columns that either has.
    pub(crate) fn union(self, other: PackageColumns) -> PackageColumns {
        PackageColumns {
            sh_degree: self.sh_degree.max(other.sh_degree),
            temporal: self.temporal.union(other.temporal),
            plate_sh_degree: self.plate_sh_degree.max(other.plate_sh_degree),
        }
    }
}

impl TemporalColumns {
    /// The columns that either has.
    fn union(self, other: TemporalColumns) -> TemporalColumns {
        TemporalColumns {
            motion_order: self.motion_order.max(other.motion_order),
            rotation_rates: self.rotation_rates || other.rotation_rates,
        }
    }
}

impl Columns {
    /// Bytes of a row in all columns.
    pub(crate) fn row_bytes(self) -> usize {
        let vectors = 2 + sh_coefficients(self.sh_degree);
        let temporal = self.temporal.map_or(0, |TemporalColumns { motion_order, rotation_rates }| {
            let vectors = usize::from(motion_order) * size_of::<[f32; 3]>();
            2 * size_of::<f32>() + vectors + usize::from(rotation_rates) * size_of::<[f32; 4]>()
        });
        vectors * size_of::<[f32; 3]>() + size_of::<[f32; 4]>() + size_of::<f32>() + temporal
    }

    /// A field of `rows` rows of zeros with these columns and the default filter.
    ///
    /// # Errors
    /// [`Error::Limits`] if `budget` does not suffice.
    pub(crate) fn zeros(self, rows: usize, budget: &mut Budget) -> Result<Field, Error> {
        Ok(Field {
            centers: budget.zeros(rows)?,
            rotations: budget.zeros(rows)?,
            log_scales: budget.zeros(rows)?,
            opacities: budget.zeros(rows)?,
            sh_degree: self.sh_degree,
            sh: budget.zeros(rows * sh_coefficients(self.sh_degree))?,
            filter: PixelFilter::default(),
            near: 0.0,
            temporal: match self.temporal {
                None => None,
                Some(TemporalColumns { motion_order, rotation_rates }) => Some(Temporal {
                    tau: budget.zeros(rows)?,
                    s: budget.zeros(rows)?,
                    motion_order,
                    motion: budget.zeros(rows * usize::from(motion_order))?,
                    rotation_rates: if rotation_rates { Some(budget.zeros(rows)?) } else { None },
                }),
            },
        })
    }

    /// The columns in which some of `rows` are not zero, temporal ones only `with_temporal`.
    #[cfg(feature = "encode")]
    pub(crate) fn nonzero(field: &Field, rows: &[usize], with_temporal: bool) -> Columns {
        let is_zero = |v: &[f32; 3]| *v == [0.0; 3];
        let has_degree = |degree: &u8| {
            *degree <= field.sh_degree
                && rows.iter().any(|&i| !field.sh_of(i)[sh_coefficients(degree - 1)..].iter().all(is_zero))
        };
        let temporal =
            field.temporal.as_ref().filter(|_| with_temporal && !rows.is_empty()).map(|temporal| {
                let has_order = |order: &u8| {
                    *order <= temporal.motion_order
                        && rows.iter().any(|&i| !is_zero(&temporal.motion_of(i)[usize::from(order - 1)]))
                };
                let rates = temporal.rotation_rates.as_ref();
                TemporalColumns {
                    motion_order: (1..=MOTION_ORDER_MAX).rev().find(has_order).unwrap_or(0),
                    rotation_rates: rates.is_some_and(|rates| rows.iter().any(|&i| rates[i] != [0.0; 4])),
                }
            });
        Columns { sh_degree: (1..=SH_DEGREE_MAX).rev().find(has_degree).unwrap_or(0), temporal }
    }

    /// The columns that either has.
    #[cfg(feature = "encode")]
    pub(crate) fn union(self, other: Columns) -> Columns {
        Columns {
            sh_degree: self.sh_degree.max(other.sh_degree),
            temporal: self.temporal.into_iter().chain(other.temporal).reduce(TemporalColumns::union),
        }
    }
}

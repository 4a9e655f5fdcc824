//! [`ImportLimits`]: a bound on the memory of an import, for any header.

use std::fs::File;
use std::io::Read;
use std::path::Path;

use codec::{Field, Temporal, sh_coefficients};

use crate::text;

/// Largest ratio of unpacked to packed bytes that is accepted: DEFLATE's ratio, in gzip and ZIP, cannot be larger.
const RATIO_MAX: u64 = 1032;

/// Bounds on what importing a file may allocate.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct ImportLimits {
    /// Largest number of bytes in memory at a time: the file, what it unpacks to, and the rows of the field.
    pub max_bytes: u64,
}

impl Default for ImportLimits {
    /// 4 GiB: 8 million Gaussians of SH degree 3 from a PLY.
    fn default() -> ImportLimits {
        ImportLimits { max_bytes: 4 << 30 }
    }
}

/// Memory left to one import.
pub(crate) struct ImportBudget {
    limit: u64,
    left: u64,
}

impl ImportBudget {
    pub(crate) fn new(limits: ImportLimits) -> ImportBudget {
        ImportBudget { limit: limits.max_bytes, left: limits.max_bytes }
    }

    /// Counts `bytes` that are about to be allocated.
    ///
    /// # Errors
    /// One sentence with both numbers, if the limit is exceeded.
    pub(crate) fn spend(&mut self, bytes: u64) -> Result<(), String> {
        match self.left.checked_sub(bytes) {
            Some(left) => {
                self.left = left;
                Ok(())
            }
            None => {
                let needed = (self.limit - self.left).saturating_add(bytes);
                Err(format!(
                    "reading it takes {} MB of memory or more, and {} MB is the limit; prune the field with the \
                     program that made it",
                    needed.div_ceil(1_000_000),
                    self.limit.div_ceil(1_000_000)
                ))
            }
        }
    }

    /// Allocates an empty vector with room for `count` elements.
    ///
    /// # Errors
    /// As [`ImportBudget::spend`] has them, or that the system has no such memory.
    pub(crate) fn vec<T>(&mut self, count: usize) -> Result<Vec<T>, String> {
        let bytes = (count as u64).saturating_mul(size_of::<T>() as u64);
        self.spend(bytes)?;
        let mut vec = Vec::new();
        vec.try_reserve_exact(count)
            .map_err(|_| format!("the system has no {bytes} bytes of memory left; close other programs"))?;
        Ok(vec)
    }

    /// Allocates a field without rows, with room for `rows` static ones.
    ///
    /// # Errors
    /// As [`ImportBudget::vec`] has them.
    pub(crate) fn field(&mut self, rows: usize, sh_degree: u8) -> Result<Field, String> {
        // Cleaning lists the usable rows.
        self.spend((rows as u64).saturating_mul(size_of::<usize>() as u64))?;
        Ok(Field {
            centers: self.vec(rows)?,
            rotations: self.vec(rows)?,
            log_scales: self.vec(rows)?,
            opacities: self.vec(rows)?,
            sh_degree,
            sh: self.vec(rows.saturating_mul(sh_coefficients(sh_degree)))?,
            ..Field::default()
        })
    }

    /// Allocates temporal columns without rows, with room for `rows`, without rotation rates.
    ///
    /// # Errors
    /// As [`ImportBudget::vec`] has them.
    pub(crate) fn temporal(&mut self, rows: usize, motion_order: u8) -> Result<Temporal, String> {
        Ok(Temporal {
            tau: self.vec(rows)?,
            s: self.vec(rows)?,
            motion_order,
            motion: self.vec(rows.saturating_mul(usize::from(motion_order)))?,
            rotation_rates: None,
        })
    }

    /// Checks that `unpacked` bytes can come from `packed` ones.
    ///
    /// # Errors
    /// One sentence with both numbers.
    pub(crate) fn check_ratio(packed: u64, unpacked: u64) -> Result<(), String> {
        match unpacked > packed.saturating_mul(RATIO_MAX) {
            true => {
                Err(format!("{packed} bytes cannot unpack to the {unpacked} bytes that the header announces"))
            }
            false => Ok(()),
        }
    }

    /// Reads a file.
    ///
    /// # Errors
    /// One sentence without the path: not a file, unreadable, larger than the limit, or a pointer of Git LFS.
    pub(crate) fn read_file(&mut self, path: &Path) -> Result<Vec<u8>, String> {
        let reason = |error: std::io::Error| error.to_string();
        let metadata = std::fs::metadata(path).map_err(reason)?;
        if !metadata.is_file() {
            return Err("not a file".into());
        }
        let mut bytes = self.vec(usize::try_from(metadata.len()).unwrap_or(usize::MAX))?;
        // A file that grows meanwhile is cut.
        File::open(path)
            .and_then(|file| file.take(metadata.len()).read_to_end(&mut bytes))
            .map_err(reason)?;
        text::large_file(&bytes).map_or(Ok(bytes), Err)
    }
}

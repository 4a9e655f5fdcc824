//! [`Poster`]: the picture that stands for a clip or a take, as a time and a view.
//!
//! A section that is not critical stores it, in the first segment of a take. `with_poster` rewrites the beginning of a
//! package; Gaussians are copied, not coded anew.

use crate::{ClipInfo, Contents, Error, FormatError, Limits, SectionKind, Viewpoint, bytes::Reader, package};

/// The picture that stands for a clip or a take: what file managers and lists of clips show.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Poster {
    /// Time in seconds after the beginning of the clip or the take, finite.
    pub time_s: f64,
    /// Position of the eye, in the axes and units of the source, finite.
    pub position: [f32; 3],
    /// Point looked at, finite.
    pub target: [f32; 3],
    /// Vertical field of view in radians, between 0 and pi.
    pub fov_y: f32,
}

impl Poster {
    /// The view of the poster, with a name for menus.
    pub fn viewpoint(&self) -> Viewpoint {
        let Poster { time_s: _, position, target, fov_y } = *self;
        Viewpoint { name: "poster".into(), position, target, fov_y }
    }

    /// Checks the ranges that the format requires, for reading and writing alike.
    ///
    /// # Errors
    /// Name and value of the first number out of range.
    pub fn check(&self) -> Result<(), (&'static str, String)> {
        if !self.time_s.is_finite() {
            return Err(("time of the poster", format!("{:?}", self.time_s)));
        }
        ClipInfo { viewpoints: vec![self.viewpoint()], ..ClipInfo::default() }.check()
    }

    /// Reads the payload of a section.
    fn read(mut reader: Reader) -> Result<Poster, Error> {
        let at = reader.at();
        let poster = Poster {
            time_s: reader.f64()?,
            position: reader.f32x3()?,
            target: reader.f32x3()?,
            fov_y: reader.f32()?,
        };
        reader.finish()?;
        let checked = poster.check();
        checked.map_err(|(field, value)| Error::format(at, FormatError::Value { field, value }))?;
        Ok(poster)
    }
}

impl Contents {
    /// Reads the poster of `package`, whose head this is, or of a prefix of it. Its time counts from clip time 0.
    ///
    /// # Errors
    /// [`Error::Format`] if the section is damaged, or `package` ends before it does.
    pub fn poster(&self, package: &[u8]) -> Result<Option<Poster>, Error> {
        let section = self.sections.iter().find(|section| section.kind == SectionKind::Poster);
        let read = section.map(|section| {
            let payload = section.payload(package)?;
            Poster::read(Reader::new(payload, section.offset, "poster"))
        });
        read.transpose()
    }
}

/// Reads the poster of a clip or a take from the beginning of its package, which holds the first layer of the first
/// segment. Its time lies in the clip or take.
///
/// # Errors
/// Those of [`package`](crate::package()), [`Take::segment_contents`](crate::Take::segment_contents) and
/// [`Contents::poster`].
pub fn poster(start: &[u8], limits: &Limits) -> Result<Option<Poster>, Error> {
    let take = package(start, limits)?;
    let segment = &take.segments[0];
    let end = start.len().min(take.head_bytes.saturating_add(segment.bytes()));
    let bytes = start.get(take.head_bytes..end).unwrap_or_default();
    let poster = take.segment_contents(0, bytes, limits)?.poster(bytes);
    let poster = poster.map_err(|error| error.rebased(take.head_bytes))?;
    let placed = |poster: &Poster| (segment.start_s + poster.time_s).clamp(0.0, take.duration_s);
    Ok(poster.map(|poster| Poster { time_s: placed(&poster), ..poster }))
}

#[cfg(feature = "encode")]
mod write {
    use super::*;
    use crate::{
        EncodeError,
        bytes::Writer,
        extra::{truncated, with_extra},
        take::{prefixes, write_take},
    };

    /// Gives a clip or a take another poster, or none. `start` is the package of a clip, or the beginning of a take up
    /// to the end of its first segment. Returns the bytes that stand in the place of `start` in the new file.
    ///
    /// # Errors
    /// - [`EncodeError::Info`] if [`Poster::check`] fails.
    /// - [`EncodeError::Package`] if `start` is not such a beginning, is damaged, or exceeds `limits`.
    /// - [`EncodeError::TooLarge`] if the package would exceed 4 GiB.
    pub fn with_poster(
        start: &[u8],
        poster: Option<&Poster>,
        limits: &Limits,
    ) -> Result<Vec<u8>, EncodeError> {
        let mut take = package(start, limits).map_err(EncodeError::Package)?;
        let segment = &take.segments[0];
        let bytes = start.get(take.head_bytes..take.head_bytes.saturating_add(segment.bytes()));
        let needed = take.head_bytes.saturating_add(segment.bytes());
        let bytes = bytes.ok_or_else(|| truncated(needed, start.len()))?;
        let contents = take.segment_contents(0, bytes, limits).map_err(EncodeError::Package)?;
        let poster = poster.map(|poster| Poster { time_s: poster.time_s - segment.start_s, ..*poster });
        let segment = rewrite(bytes, contents, poster.as_ref())?;
        if take.head_bytes == 0 {
            // A clip, which has no table.
            return Ok(segment);
        }
        let contents = crate::contents(&segment, limits).map_err(EncodeError::Package)?;
        take.segments[0].head_crc = contents.head_crc;
        take.segments[0].layers = prefixes(&contents);
        let mut written = write_take(&take)?;
        written.extend_from_slice(&segment);
        Ok(written)
    }

    /// The package of a clip with another poster, or none.
    fn rewrite(package: &[u8], contents: Contents, poster: Option<&Poster>) -> Result<Vec<u8>, EncodeError> {
        let checked = poster.map_or(Ok(()), Poster::check);
        checked.map_err(|(field, value)| EncodeError::Info { field, value })?;
        with_extra(package, contents, SectionKind::Poster, poster.map(payload).as_deref())
    }

    /// The bytes of a section.
    fn payload(poster: &Poster) -> Vec<u8> {
        let mut writer = Writer::default();
        writer.f64(poster.time_s);
        writer.f32x3(poster.position);
        writer.f32x3(poster.target);
        writer.f32(poster.fov_y);
        writer.bytes
    }
}

#[cfg(feature = "encode")]
pub use write::with_poster;

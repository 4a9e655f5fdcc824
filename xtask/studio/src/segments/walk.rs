//! [`TakeWalk`]: the segments of a take that hold one instant after another, decoded.

use std::collections::BTreeMap;
use std::path::Path;

use refine::reference::RenderScene;

use super::decoded::{SegmentContent, read_segment};
use super::file::TakeFile;
use super::folder::FieldFolder;
use super::span::Span;

/// A walk along a take. Memory holds the segments of one instant.
#[derive(Debug)]
pub(crate) struct TakeWalk<'a> {
    source: WalkSource<'a>,
    /// Duration of the take in seconds.
    duration_s: f64,
    spans: Vec<Span>,
    held: BTreeMap<usize, SegmentContent>,
}

#[derive(Debug)]
enum WalkSource<'a> {
    File(&'a TakeFile),
    Folder(FieldFolder),
}

impl<'a> TakeWalk<'a> {
    /// A walk along a package.
    pub(crate) fn of_file(file: &'a TakeFile) -> TakeWalk<'a> {
        let take = file.take();
        let spans = take.segments.iter().map(Span::from).collect();
        TakeWalk::new(WalkSource::File(file), take.duration_s, spans)
    }

    /// A walk along a field folder.
    ///
    /// # Errors
    /// Those of [`FieldFolder::open`].
    pub(crate) fn of_folder(path: &Path) -> Result<TakeWalk<'static>, program::Fault> {
        let folder = FieldFolder::open(path)?;
        let spans = (0..folder.len()).map(|index| folder.span(index)).collect();
        let duration_s = folder.duration_s;
        Ok(TakeWalk::new(WalkSource::Folder(folder), duration_s, spans))
    }

    fn new(source: WalkSource<'a>, duration_s: f64, spans: Vec<Span>) -> TakeWalk<'a> {
        TakeWalk { source, duration_s, spans, held: BTreeMap::new() }
    }

    /// Duration of the take in seconds.
    pub(crate) fn duration_s(&self) -> f64 {
        self.duration_s
    }

    /// Goes to second `t_s`: decodes the segments that hold it and were not held before, and drops the others.
    ///
    /// # Errors
    /// That names a segment that cannot be read.
    pub(crate) fn go_to(&mut self, t_s: f64) -> anyhow::Result<()> {
        let TakeWalk { source, duration_s, spans, held } = self;
        held.retain(|&index, _| spans[index].holds(*duration_s, t_s));
        for (index, _) in spans.iter().enumerate().filter(|(_, span)| span.holds(*duration_s, t_s)) {
            if held.contains_key(&index) {
                continue;
            }
            let content = match source {
                WalkSource::File(file) => SegmentContent::Clip(Box::new(file.decode(index)?)),
                WalkSource::Folder(folder) => read_segment(folder, index)?,
            };
            held.insert(index, content);
        }
        Ok(())
    }

    /// The segments of this instant for the reference renderer, the first `layers` layers of packages; all without a
    /// number.
    pub(crate) fn to_reference(&self, layers: Option<usize>) -> RenderScene<'_> {
        let layers = layers.unwrap_or(usize::MAX);
        RenderScene::of_take(self.held.iter().map(|(&index, content)| {
            (self.spans[index].in_scene(self.duration_s), content.layers_to_reference(layers))
        }))
    }

    /// Number of segments that hold this instant.
    pub(crate) fn segments(&self) -> usize {
        self.held.len()
    }

    /// Number of their Gaussians, backgrounds included.
    pub(crate) fn gaussians(&self) -> usize {
        self.held.values().map(SegmentContent::len).sum()
    }
}

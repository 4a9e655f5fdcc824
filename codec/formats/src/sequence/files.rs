//! [`SequenceFiles`]: which files of a folder are the frames of a sequence, and which frames are missing. [`last_stage`]:
//! numbered files that are stages of one fit instead.

use std::collections::BTreeMap;
use std::path::{Path, PathBuf};

/// Fewest files that are taken for a sequence: two numbered fields are more often two stages of one fit.
pub(super) const FRAMES_MIN: usize = 3;

/// Most frames of a sequence, missing ones included.
const STEPS_MAX: usize = 1_000_000;

/// Names before the number of a stage: of Brush, OpenSplat and gsplat, and of folders of 3D Gaussian Splatting.
const STAGES: [&str; 4] = ["export_", "iteration_", "splat_", "point_cloud_"];

/// Fewest steps of an optimiser from one stage to the next; frames are numbered more closely.
const STAGE_MIN: u64 = 100;

/// The frames of a sequence in a folder: fields of one format whose names differ in their last number.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct SequenceFiles {
    /// The files in the order of their numbers, each with its step in the clip: 0 for the first frame, and more than one
    /// further where frames are missing between.
    pub frames: Vec<(usize, PathBuf)>,
}

impl SequenceFiles {
    /// The sequence that the field files `names` in `folder` are; `None` if they are none: fewer than three, named
    /// otherwise than by their last number, or numbered beyond a million frames.
    pub fn find(folder: &Path, names: &[&str]) -> Option<SequenceFiles> {
        let (_, numbered) = numbered(names)?;
        let first = *numbered.keys().next()?;
        let step = numbered.keys().fold(0, |step, number| greatest_common_divisor(step, number - first));
        let step_of = |number: u64| {
            let step = usize::try_from((number - first).checked_div(step)?).ok();
            step.filter(|step| *step < STEPS_MAX)
        };
        let frames: Vec<(usize, PathBuf)> = numbered
            .iter()
            .map(|(&number, name)| Some((step_of(number)?, folder.join(name))))
            .collect::<Option<_>>()?;
        (frames.len() >= FRAMES_MIN).then_some(SequenceFiles { frames })
    }

    /// Number of frames from the first to the last, missing ones included.
    pub fn steps(&self) -> usize {
        self.frames.last().map_or(0, |(step, _)| step + 1)
    }

    /// The missing frames as text, at most four of them; `None` if there are none.
    pub(super) fn missing(&self) -> Option<String> {
        let gaps = self.frames.windows(2).flat_map(|pair| pair[0].0 + 1..pair[1].0);
        let count = self.steps() - self.frames.len();
        let mut listed: Vec<String> = gaps.take(4).map(|step| step.to_string()).collect();
        if count > listed.len() {
            listed.push(format!("{} more", count - listed.len()));
        }
        let noun = if count == 1 { "frame" } else { "frames" };
        (count > 0).then(|| format!("{noun} {} (counted from 0)", listed.join(", ")))
    }
}

/// The last of field files that are stages of one fit: named alike as programs name these, with numbers far apart. `None`
/// if they are none.
pub(crate) fn last_stage<'n>(names: &[&'n str]) -> Option<&'n str> {
    let (before, numbered) = numbered(names)?;
    let numbers: Vec<u64> = numbered.keys().copied().collect();
    let is_apart = numbers.windows(2).all(|pair| pair[1] - pair[0] >= STAGE_MIN);
    let last = numbered.into_values().next_back();
    last.filter(|_| STAGES.contains(&before) && is_apart)
}

/// What names that differ in their last number have before it, and the names by these numbers; `None` if they differ
/// otherwise.
fn numbered<'n>(names: &[&'n str]) -> Option<(&'n str, BTreeMap<u64, &'n str>)> {
    let mut numbered = BTreeMap::new();
    let mut around = None;
    for &name in names {
        let (before, number, after) = split_number(name)?;
        if *around.get_or_insert((before, after)) != (before, after) {
            return None;
        }
        // Two ways to write one number, such as 1 and 01.
        if numbered.insert(number, name).is_some() {
            return None;
        }
    }
    Some((around?.0, numbered))
}

/// A name before its last number, the number, and the name after it.
fn split_number(name: &str) -> Option<(&str, u64, &str)> {
    let end = name.rfind(|c: char| c.is_ascii_digit())? + 1;
    let start = name[..end].rfind(|c: char| !c.is_ascii_digit()).map_or(0, |at| at + 1);
    // A character before the number may have several bytes.
    let start = (start..end).find(|&at| name.is_char_boundary(at))?;
    Some((&name[..start], name[start..end].parse().ok()?, &name[end..]))
}

fn greatest_common_divisor(a: u64, b: u64) -> u64 {
    if b == 0 { a } else { greatest_common_divisor(b, a % b) }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn steps(names: &[&str]) -> Option<Vec<usize>> {
        let files = SequenceFiles::find(Path::new("a"), names)?;
        Some(files.frames.into_iter().map(|(step, _)| step).collect())
    }

    #[test]
    fn numbers_give_the_order_and_the_gaps() {
        assert_eq!(steps(&["f-10.ply", "f-8.ply", "f-9.PLY", "f-11.ply"]), None, "another ending");
        assert_eq!(steps(&["f-10.ply", "f-8.ply", "f-9.ply"]), Some(vec![0, 1, 2]));
        assert_eq!(steps(&["05.ply", "10.ply", "25.ply", "15.ply"]), Some(vec![0, 1, 2, 4]));
        assert_eq!(steps(&["é1.ply", "é2.ply", "é3.ply"]), Some(vec![0, 1, 2]));
        let gaps = SequenceFiles::find(Path::new("a"), &["1.ply", "2.ply", "9.ply"]).unwrap();
        assert_eq!(gaps.missing().unwrap(), "frames 2, 3, 4, 5, 2 more (counted from 0)");
        let one = SequenceFiles::find(Path::new("a"), &["1.ply", "2.ply", "4.ply"]).unwrap();
        assert_eq!((one.missing().unwrap().as_str(), one.steps()), ("frame 2 (counted from 0)", 4));
    }

    #[test]
    fn stages_of_a_fit_are_named_as_such_with_numbers_far_apart() {
        let brush = ["export_5000.ply", "export_15000.ply", "export_10000.ply"];
        assert_eq!(last_stage(&brush), Some("export_15000.ply"));
        assert_eq!(
            last_stage(&["point_cloud_6999.ply", "point_cloud_29999.ply"]),
            Some("point_cloud_29999.ply")
        );
        for frames in [
            &["export_5000.ply", "export_5001.ply", "export_5200.ply"][..],
            &["frame_5000.ply", "frame_10000.ply"],
            &["export_5000.ply", "splat_10000.ply"],
            &["export_5000.ply", "export_10000.spz"],
            &[],
        ] {
            assert_eq!(last_stage(frames), None, "{frames:?}");
        }
    }

    #[test]
    fn other_files_are_no_sequence() {
        for names in [
            &["a1.ply", "a2.ply"][..],
            &["a.ply", "b.ply", "c.ply"],
            &["a1.ply", "a2.ply", "b3.ply"],
            &["a1.ply", "a01.ply", "a2.ply"],
            &["a1.spz", "a2.spz", "a3.ply"],
            &["99999999999999999999999.ply", "1.ply", "2.ply"],
            &["0.ply", "1.ply", "18446744073709551615.ply"],
        ] {
            assert_eq!(steps(names), None, "{names:?}");
        }
    }
}

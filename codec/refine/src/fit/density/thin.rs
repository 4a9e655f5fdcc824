//! [`thin`]: leaves out the still Gaussians that show least for the pixels that they cover.
//!
//! Densification adds Gaussians where pictures are wrong, and hidden ones stay as long as they are opaque: a room ends with
//! many that others hide or that lie thinly over a wall. A player pays for every pixel that they cover. The steps after
//! densification make up for the Gaussians that are left out.

use codec::Field;

use crate::fit::optimizer::Moments;
use crate::fit::parameters::{Parameters, Timeline};
use crate::fit::views::TrainingView;
use crate::prune::{by_importance, contributions_to, weight_per_fragment, within_fragments};
use crate::reference::PosedView;

/// Fraction of the fragments of still Gaussians that stays.
const FRAGMENTS: f64 = 0.7;

/// Most cameras whose fragments are counted.
const CAMERAS_MAX: usize = 128;

/// Leaves out the still Gaussians that show least for the pixels that they cover in the pictures of the cameras of
/// `views`, but never so many that fewer than `floor` Gaussians are left in front of the plate. Returns how many.
pub(in crate::fit) fn thin(
    floor: usize,
    parameters: &mut Parameters<f32>,
    moments: &mut Moments<f32>,
    timeline: Timeline,
    views: &[&TrainingView],
) -> usize {
    let count = parameters.len();
    // In front of a plate, a subject in one frame is none of them.
    let is_still = |row: &usize| match moments.carried.is_empty() {
        true => parameters.tau.is_empty(),
        false => moments.is_static(*row),
    };
    let still: Vec<usize> = (0..count).filter(|row| moments.is_own(*row) && is_still(row)).collect();
    if still.is_empty() {
        return 0;
    }
    let field = Field { temporal: None, ..parameters.select(&still).to_field(timeline) };
    let seen = contributions_to(&cameras(views), &field, || ());
    let order = by_importance(&weight_per_fragment(&seen));
    let of_plate = (0..count).filter(|row| parameters.is_behind(*row)).count();
    // Without a plate, what stands still counts for the floor, too.
    let least = if of_plate > 0 { 0 } else { floor.saturating_sub(count - still.len()) };
    let kept = within_fragments(&order, &seen, FRAGMENTS).max(least);
    let mut stays = vec![true; count];
    order.iter().skip(kept).for_each(|row| stays[still[*row]] = false);
    let rows: Vec<usize> = (0..count).filter(|row| stays[*row]).collect();
    *parameters = parameters.select(&rows);
    *moments = moments.select(&rows);
    count - rows.len()
}

/// The cameras of `views`, or some of them, evenly.
fn cameras(views: &[&TrainingView]) -> Vec<PosedView> {
    let mut views = views.to_vec();
    views.sort_by_key(|view| view.camera_id);
    views.dedup_by_key(|view| view.camera_id);
    let every = views.len().div_ceil(CAMERAS_MAX).max(1);
    views.iter().step_by(every).map(|view| PosedView { camera: view.camera.clone(), t: 0.0 }).collect()
}

#[cfg(test)]
mod tests {
    use codec::Camera;

    use super::*;
    use crate::fit::parameters::Carried;
    use crate::fit::views::Photograph;

    fn view(camera_id: usize, x: f64) -> TrainingView {
        let camera = Camera::look_at([x, 0.0, -4.0], [0.0; 3], [0.0, -1.0, 0.0], 0.8, 32, 32);
        let photograph = Photograph { width: 32, height: 32, pixels: Vec::new(), valid: Vec::new() };
        TrainingView { camera_id, camera, time: 0.0, photograph }
    }

    /// Opaque Gaussians in a row, and faint ones as large as the picture; their colours number them.
    fn parameters(opaque: usize, faint: usize) -> Parameters<f32> {
        let rows = opaque + faint;
        let is_opaque = |row: usize| row < opaque;
        Parameters {
            centers: (0..rows).map(|row| [0.2 * row as f32 - 0.5, 0.0, 0.0]).collect(),
            rotations: vec![[1.0, 0.0, 0.0, 0.0]; rows],
            log_scales: (0..rows).map(|row| [if is_opaque(row) { -2.5 } else { 0.5 }; 3]).collect(),
            logits: (0..rows).map(|row| if is_opaque(row) { 3.0 } else { -4.0 }).collect(),
            sh: (0..rows).map(|row| [row as f32; 3]).collect(),
            ..Parameters::default()
        }
    }

    fn thinned(floor: usize, mut parameters: Parameters<f32>, carried: Vec<Carried>) -> Vec<usize> {
        let mut moments = Moments { carried, ..Moments::new(&parameters) };
        moments.visits = (0..parameters.len() as u32).collect();
        let count = parameters.len();
        let views = [view(0, 0.0), view(0, 0.0), view(1, 1.0)];
        let views: Vec<&TrainingView> = views.iter().collect();
        let dropped = thin(floor, &mut parameters, &mut moments, Timeline::even(3), &views);
        let rows: Vec<usize> = parameters.sh.iter().map(|sh| sh[0] as usize).collect();
        assert_eq!(moments.visits, rows.iter().map(|row| *row as u32).collect::<Vec<u32>>());
        assert_eq!(dropped, count - rows.len());
        rows
    }

    #[test]
    fn what_covers_most_for_what_it_shows_goes() {
        // The faint ones have nearly all fragments: two of four are within the budget.
        assert_eq!(thinned(0, parameters(4, 4), Vec::new()), [0, 1, 2, 3, 4, 5]);
        assert_eq!(thinned(7, parameters(4, 4), Vec::new()).len(), 7, "the floor");
        assert_eq!(thinned(99, parameters(4, 4), Vec::new()).len(), 8);
    }

    /// Rows that move, with the numbers 0 to 2, and then still ones as [`parameters`] has them.
    fn in_front_of_still_ones(opaque: usize, faint: usize) -> Parameters<f32> {
        let mut all = parameters(opaque + 3, faint);
        all.tau = vec![1.0; all.len()];
        all.log_widths = vec![0.5; all.len()];
        all
    }

    #[test]
    fn what_moves_and_what_other_fits_have_a_part_in_stays() {
        let carried = |of_still: Carried| [vec![Carried::NONE; 3], vec![of_still; 8]].concat();
        let all = || in_front_of_still_ones(4, 4);
        assert_eq!(thinned(0, all(), carried(Carried::STATIC)), [0, 1, 2, 3, 4, 5, 6, 7, 8]);
        assert_eq!(thinned(10, all(), carried(Carried::STATIC)).len(), 10, "still ones count for the floor");
        let plate = Parameters { behind: [vec![false; 3], vec![true; 8]].concat(), ..all() };
        assert_eq!(thinned(10, plate, carried(Carried::STATIC)).len(), 9, "but those of a plate");
        assert_eq!(thinned(0, all(), carried(Carried::NONE)).len(), 11);
        assert_eq!(thinned(0, all(), carried(Carried { share: 0.5, ..Carried::STATIC })).len(), 11);
        // One frame: nothing has a time, and the subject is no part of the plate.
        let of_one_frame = Parameters { tau: Vec::new(), log_widths: Vec::new(), ..all() };
        assert_eq!(thinned(0, of_one_frame.clone(), carried(Carried::STATIC)), [0, 1, 2, 3, 4, 5, 6, 7, 8]);
        assert_eq!(thinned(0, of_one_frame, carried(Carried::NONE)).len(), 11);
    }

    #[test]
    fn cameras_count_once_and_many_are_sampled() {
        let views: Vec<TrainingView> = (0..600).map(|i| view(i % 300, i as f64)).collect();
        let all: Vec<&TrainingView> = views.iter().collect();
        assert_eq!(cameras(&all[..7]).len(), 7);
        assert_eq!(cameras(&all[298..302]).len(), 4);
        assert_eq!(cameras(&all).len(), 100);
        assert!(cameras(&[]).is_empty());
    }
}

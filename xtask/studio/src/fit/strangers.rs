//! [`name_strangers`]: cameras whose photographs show something else than the photographs of the others;
//! [`name_dark`]: cameras whose photographs show nothing; [`name_covered`]: cameras whose photographs do not show their plates.
//!
//! A fit explains the plate of a stranger, too: by Gaussians before it that no other camera sees, and by a gain next to 0. So
//! those Gaussians are left out, and gains do not count. Where no other camera looks, nothing contradicts a camera. One without
//! light is fitted as one of little gain, so its photographs themselves tell.

use std::collections::BTreeMap;

use refine::capture::CalibratedCamera;
use refine::fit::{Backend, DeviceError, Fit, Parameters, Photograph, RenderedImage, Run, TrainingView};
use refine::metrics::median;
use refine::reference::{Order, contributions};

use super::training_views::TrainingViews;

/// A Gaussian is of one camera alone if so much of its weight in all plates is in that camera's.
const OWN_MIN: f64 = 0.5;

/// Alpha from which on the Gaussians of other cameras show a pixel, and the least share of such pixels that tells something.
const SHOWN_MIN: f32 = 0.9;
const SHOWN_SHARE_MIN: f64 = 0.1;

/// Least standard deviation, of 1, of what others show of a plate: the variance of a bare wall is noise.
const TEXTURE_MIN: f64 = 0.02;

/// A camera is a stranger if the others explain less of its plate than this share of the median.
const EXPLAINED_SHARE_MIN: f64 = 0.5;

/// A camera has no light if the [`brightness`] of its photographs is below this level of 255, and below this share of what
/// others have.
const DARK_MAX: u8 = 20;
const DARK_SHARE_MAX: f64 = 0.25;

/// Share of the cameras that have light at least: one lamp is none.
const LIT_SHARE: f64 = 0.25;

/// A camera does not show its plate if more than this share of its pixels never do.
const COVERED_MIN: f64 = 0.25;

/// Share of the pixels of a photograph, the brightest, that may be lamps or noise.
const BRIGHTEST: f64 = 0.01;

/// Steps from which on the plate of a right camera is explained.
const STEPS_MIN: u64 = 2000;

/// Names the strangers among `cameras` in a line each, from the fit to the plates that are `views`.
///
/// # Errors
/// A [`DeviceError`].
pub(super) fn name_strangers(
    fit: &Fit,
    views: &TrainingViews,
    cameras: &[CalibratedCamera],
    backend: &mut dyn Backend,
) -> Result<(), DeviceError> {
    if fit.steps_done() < STEPS_MIN {
        return Ok(());
    }
    let explained = explained_by_others(fit, views, backend)?;
    let brightnesses: Vec<u8> = views.train.iter().map(|(_, view)| brightness(&view.photograph)).collect();
    let dark = dark(&brightnesses);
    for i in strangers(&explained).into_iter().filter(|i| !dark.contains(i)) {
        eprintln!(
            "note: camera {} shows something else than the others do (they explain {:.0} % of it, and {:.0} % of most): check \
             its calibration, and whether its files are of another camera; \"held\": true in capture.json leaves it out",
            cameras[views.train[i].1.camera_id].name,
            100.0 * explained[i].unwrap_or_default(),
            100.0 * typical(&explained)
        );
    }
    Ok(())
}

/// Names the cameras whose whole photographs, which are `views`, show next to nothing, in one line.
pub(super) fn name_dark(views: &TrainingViews, cameras: &[CalibratedCamera]) {
    let mut brightnesses = BTreeMap::new();
    for (_, view) in &views.train {
        let most: &mut u8 = brightnesses.entry(view.camera_id).or_default();
        *most = brightness(&view.photograph).max(*most);
    }
    let (camera_ids, brightnesses): (Vec<usize>, Vec<u8>) = brightnesses.into_iter().unzip();
    let dark = dark(&brightnesses);
    let Some(most) = dark.iter().map(|i| brightnesses[*i]).max() else { return };
    let names: Vec<&str> = dark.iter().map(|i| cameras[camera_ids[*i]].name.as_str()).collect();
    eprintln!(
        "note: next to nothing is seen by {} (levels to {most} of 255): check light and lid; \"held\": true in capture.json \
         leaves a camera out",
        listed(&names)
    );
}

/// Names the cameras without a photograph in `views`, with mattes, that shows much of the plate.
pub fn name_covered(views: &TrainingViews, cameras: &[CalibratedCamera]) {
    let share = |i: usize| {
        let of_camera = views.train.iter().filter(|(photo_id, _)| photo_id.camera == i);
        covered_share(&of_camera.map(|(_, view)| &view.photograph).collect::<Vec<_>>())
    };
    let shares = cameras.iter().enumerate().map(|(i, camera)| (camera.name.as_str(), share(i)));
    let covered: Vec<(&str, f64)> = shares.filter(|(_, share)| *share > COVERED_MIN).collect();
    let Some(least) = covered.iter().map(|(_, share)| *share).reduce(f64::min) else { return };
    eprintln!(
        "note: all photographs of {} differ from the plate in {:.0} % of the pixels or more: check that plates in capture.json \
         are of these cameras and this light; without plates there, they are found",
        listed(&covered.iter().map(|(name, _)| *name).collect::<Vec<_>>()),
        100.0 * least
    );
}

/// The cameras of these names, in a sentence.
fn listed(names: &[&str]) -> String {
    match names {
        [name] => format!("camera {name}"),
        names => format!("cameras {}", names.join(", ")),
    }
}

/// Share of the pixels that show the subject in all photographs of a camera.
fn covered_share(photographs: &[&Photograph]) -> f64 {
    let Some(first) = photographs.first() else { return 0.0 };
    let count = first.pixels.len();
    let is_covered = |pixel: &usize| photographs.iter().all(|photograph| photograph.is_subject(*pixel));
    (0..count).filter(is_covered).count() as f64 / count as f64
}

/// How much of the plate of each view the Gaussians explain that are not of its camera alone; `None` where they show too
/// little.
fn explained_by_others(
    fit: &Fit,
    views: &TrainingViews,
    backend: &mut dyn Backend,
) -> Result<Vec<Option<f64>>, DeviceError> {
    let field = fit.to_field();
    let parameters = Parameters::<f32>::from_field(&field, views.timeline);
    let plates: Vec<&TrainingView> = views.train.iter().map(|(_, view)| view).collect();
    let weights: Vec<Vec<f64>> = plates
        .iter()
        .map(|view| {
            contributions(&field, &view.camera, 0.0, Order::Depth).iter().map(|row| row.weight).collect()
        })
        .collect();
    let of_all = |row: usize| weights.iter().map(|weights| weights[row]).sum::<f64>();
    let of_all: Vec<f64> = (0..field.len()).map(of_all).collect();
    let explained = |(view, weights): (&&TrainingView, &Vec<f64>)| {
        let rows: Vec<usize> =
            (0..field.len()).filter(|row| weights[*row] <= OWN_MIN * of_all[*row]).collect();
        if rows.is_empty() {
            return Ok(None);
        }
        let cameras = plates.iter().map(|view| &view.camera);
        let others = Fit::new(*fit.settings(), parameters.select(&rows), views.timeline, cameras);
        let picture = Run::start(others, &mut *backend)?.render(view)?;
        Ok(explained(&picture, &view.photograph))
    };
    plates.iter().zip(&weights).map(explained).collect()
}

/// Share of the variance of `picture` that a plate shows, too, but for one gain and offset of each channel; `None` where the
/// picture is empty or bare.
fn explained(picture: &RenderedImage<f32>, plate: &Photograph) -> Option<f64> {
    let is_shown = |pixel: &usize| plate.is_valid(*pixel) && picture.pixels[*pixel][3] > SHOWN_MIN;
    let shown: Vec<usize> = (0..plate.pixels.len()).filter(is_shown).collect();
    let count = shown.len() as f64;
    let (mut variance, mut common) = (0.0, 0.0);
    for channel in 0..3 {
        let levels = |pixel: &usize| {
            [f64::from(picture.pixels[*pixel][channel]), f64::from(plate.pixels[*pixel][channel]) / 255.0]
        };
        let mean = [0, 1].map(|i| shown.iter().map(|pixel| levels(pixel)[i]).sum::<f64>() / count);
        let covariance = |i: usize, j: usize| {
            let product = |pixel| {
                let levels = levels(pixel);
                (levels[i] - mean[i]) * (levels[j] - mean[j])
            };
            shown.iter().map(product).sum::<f64>() / count
        };
        variance += covariance(0, 0);
        let [of_both, of_plate] = [covariance(0, 1), covariance(1, 1)];
        if of_both > 0.0 {
            common += of_both * of_both / of_plate;
        }
    }
    let tells =
        count >= SHOWN_SHARE_MIN * plate.pixels.len() as f64 && variance >= 3.0 * TEXTURE_MIN * TEXTURE_MIN;
    tells.then_some(common / variance)
}

/// Indices of the plates that others explain far less than most.
fn strangers(explained: &[Option<f64>]) -> Vec<usize> {
    let least = EXPLAINED_SHARE_MIN * typical(explained);
    (0..explained.len()).filter(|i| explained[*i].is_some_and(|explained| explained < least)).collect()
}

/// Median of what is known; 0 if nothing is.
fn typical(explained: &[Option<f64>]) -> f64 {
    median(explained.iter().copied().flatten().collect()).unwrap_or(0.0)
}

/// The level that the pixels of a photograph have at most, but for the brightest.
fn brightness(photograph: &Photograph) -> u8 {
    let mut counts = [0_usize; 256];
    for (pixel, [r, g, b, _]) in photograph.pixels.iter().enumerate() {
        counts[usize::from(*r.max(g).max(b))] += usize::from(photograph.is_valid(pixel));
    }
    let mut above = (BRIGHTEST * counts.iter().sum::<usize>() as f64) as usize;
    for level in (0..=u8::MAX).rev() {
        match above.checked_sub(counts[usize::from(level)]) {
            Some(left) => above = left,
            None => return level,
        }
    }
    u8::MAX
}

/// Indices of the cameras without light, where some of the others have light.
fn dark(brightnesses: &[u8]) -> Vec<usize> {
    let mut brightest = brightnesses.to_vec();
    brightest.sort_unstable_by(|a, b| b.cmp(a));
    let Some(lit) = brightest.get((LIT_SHARE * (brightest.len() as f64 - 1.0)) as usize) else {
        return Vec::new();
    };
    let limit = DARK_SHARE_MAX * f64::from(*lit);
    let is_dark = |level: u8| level < DARK_MAX && f64::from(level) < limit;
    (0..brightnesses.len()).filter(|i| is_dark(brightnesses[*i])).collect()
}

#[cfg(test)]
mod tests {
    use codec::{Camera, Field, PixelFilter, SH_C0};
    use refine::capture::PhotoId;
    use refine::fit::{Cpu, FitSettings, Timeline};

    use super::*;

    const SIDE: u32 = 24;

    fn photograph(pixel: impl Fn(usize) -> [u8; 4]) -> Photograph {
        let pixels = (0..(SIDE * SIDE) as usize).map(pixel).collect();
        Photograph { width: SIDE, height: SIDE, pixels, valid: Vec::new() }
    }

    /// Round Gaussians of these centres, sizes and gray levels.
    fn field(rows: &[([f32; 3], f32, f32)]) -> Field {
        Field {
            centers: rows.iter().map(|(center, ..)| *center).collect(),
            rotations: vec![[1.0, 0.0, 0.0, 0.0]; rows.len()],
            log_scales: rows.iter().map(|(_, size, _)| [size.ln(); 3]).collect(),
            opacities: vec![0.99; rows.len()],
            sh: rows.iter().map(|(.., level)| [(level - 0.5) / SH_C0 as f32; 3]).collect(),
            filter: PixelFilter::Blur,
            ..Field::default()
        }
    }

    /// A wall before four cameras, and before the last one right at it another picture, which its photograph shows.
    fn views_and_field() -> (TrainingViews, Field) {
        let camera = |i: usize| {
            Camera::look_at([0.4 * i as f64 - 0.6, 0.0, -3.0], [0.0; 3], [0.0, -1.0, 0.0], 0.6, SIDE, SIDE)
        };
        let wall = (0..400).map(|i| {
            let at = [i % 20, i / 20].map(|at| 0.2 * at as f32 - 1.9);
            ([at[0], at[1], 0.0], 0.12, if (i / 3 + i / 80) % 2 == 0 { 0.2 } else { 0.8 })
        });
        let before = (0..36).map(|i| {
            let [x, y] = [i % 6, i / 6].map(|at| 0.05 * at as f32 - 0.125);
            ([0.55 + x, y, -2.6], 0.03, if i % 6 < 3 { 0.9 } else { 0.1 })
        });
        let field = field(&wall.chain(before).collect::<Vec<_>>());
        let mut backend = Cpu::default();
        let view = |i: usize| {
            let empty = photograph(|_| [0, 0, 0, 255]);
            let view = TrainingView { camera_id: i, camera: camera(i), time: 0.0, photograph: empty };
            (PhotoId { frame: 0, camera: i }, view)
        };
        let mut views = TrainingViews {
            train: (0..4).map(view).collect(),
            held: Vec::new(),
            timeline: Timeline::even(1),
            responses: Vec::new(),
        };
        let fit = fit(&field, &views);
        for (_, view) in &mut views.train {
            let picture = Run::start(fit.clone(), &mut backend).unwrap().render(view).unwrap();
            view.photograph = photograph(|pixel| {
                let [r, g, b, _] = picture.pixels[pixel].map(|level| (255.0 * level).round() as u8);
                [r, g, b, 255]
            });
        }
        (views, field)
    }

    fn fit(field: &Field, views: &TrainingViews) -> Fit {
        let parameters = Parameters::from_field(field, views.timeline);
        let cameras = views.train.iter().map(|(_, view)| &view.camera);
        Fit::new(FitSettings::default(), parameters, views.timeline, cameras)
    }

    /// The fit explains the plates of all of them.
    #[test]
    fn what_is_right_before_a_camera_does_not_explain_its_plate() {
        let (views, field) = views_and_field();
        let explained = explained_by_others(&fit(&field, &views), &views, &mut Cpu::default()).unwrap();

        assert!(explained[..3].iter().all(|explained| explained.unwrap() > 0.95), "{explained:?}");
        assert_eq!(strangers(&explained), [3]);
    }

    #[test]
    fn a_plate_is_explained_but_for_a_gain_and_an_offset() {
        let ramp = |i: usize| (i % SIDE as usize) as f32 / SIDE as f32;
        let picture = |level: &dyn Fn(usize) -> f32, alpha: f32| RenderedImage {
            width: SIDE,
            height: SIDE,
            pixels: (0..(SIDE * SIDE) as usize).map(|i| [level(i), level(i), level(i), alpha]).collect(),
        };
        let plate = |level: &dyn Fn(usize) -> f32| photograph(|i| [(255.0 * level(i)) as u8; 4]);
        let seen = picture(&ramp, 1.0);
        let share = |level: &dyn Fn(usize) -> f32| explained(&seen, &plate(level)).unwrap();
        assert!(share(&ramp) > 0.999 && share(&|i| 0.1 + 0.3 * ramp(i)) > 0.99);
        assert!(share(&|i| 1.0 - ramp(i)) == 0.0 && share(&|_| 0.4) == 0.0);
        assert!(share(&|i| (i / SIDE as usize) as f32 / SIDE as f32) < 0.01, "the ramp, turned");
        assert_eq!(explained(&picture(&|i| 0.4 + 0.01 * ramp(i), 1.0), &plate(&ramp)), None, "a bare wall");
        assert_eq!(explained(&picture(&ramp, 0.5), &plate(&ramp)), None, "nobody else looks there");
    }

    #[test]
    fn strangers_are_far_below_the_median() {
        let [right, worse, other] = [Some(0.8), Some(0.5), Some(0.2)];
        assert_eq!(strangers(&[right, other, right, worse, None]), [1]);
        // No camera is a stranger where there is nothing to compare with.
        assert!(strangers(&[other, other, other]).is_empty() && strangers(&[None]).is_empty());
        assert!(strangers(&[]).is_empty());
    }

    #[test]
    fn cameras_without_light_are_found_where_others_have_some() {
        let plate =
            |level: u8, lamp: u8| brightness(&photograph(|i| [if i == 7 { lamp } else { level }, 0, 0, 255]));
        let (lit, closed) = (plate(120, 120), plate(3, 255));
        assert_eq!((lit, closed), (120, 3), "one pixel of noise is no light");
        assert_eq!(dark(&[lit, closed, lit]), [1]);
        assert_eq!(dark(&[closed, closed, lit, closed, lit, lit]), [0, 1, 3], "half of them");
        assert_eq!(dark(&[closed, closed, lit, closed, lit, closed]), [0, 1, 3, 5], "and more");
        assert!(dark(&[closed, closed, closed]).is_empty() && dark(&[]).is_empty(), "a night");
        assert!(dark(&[lit, plate(30, 30), lit]).is_empty(), "a dim camera");
    }

    #[test]
    fn a_plate_is_covered_where_no_photograph_shows_it() {
        let from = |first: usize| photograph(move |i| [9, 9, 9, if i >= first { 255 } else { 0 }]);
        let (some, more) = (from(144), from(432));
        assert_eq!(covered_share(&[&some, &more]), 0.25);
        assert_eq!(covered_share(&[&some]), 0.75);
        assert_eq!(covered_share(&[]), 0.0);
    }

    #[test]
    fn cameras_are_listed() {
        assert_eq!([listed(&["a"]), listed(&["a", "b"])], ["camera a", "cameras a, b"]);
    }
}

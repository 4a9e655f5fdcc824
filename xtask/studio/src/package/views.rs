//! The views that rank Gaussians and steer the coder, and the views that judge.
//!
//! They come from the viewpoints that the source states and from where people stand, over all of time: a player lets its user
//! walk around. Judging views differ from steering views, so that no choice is judged by the pictures that led to it. A view
//! that shows next to nothing, or one Gaussian's inside, does not count.

use codec::{Camera, CoarseField, Field, Sight, StandPoints, Surroundings};
use rayon::prelude::*;
use refine::prune::{instants, steps_aside};
use refine::reference::PosedView;
use refine::reference::RenderScene;

use crate::scene::Scene;

/// Size in pixels of the ranking and judging pictures.
const SIZE: (u32, u32) = (256, 192);

/// Number of views that steer, that judge selections, and, for each placement, that rank: half from the source's viewpoints,
/// half from all around.
const STEERING: usize = 24;

/// Number of views that judge the coding error. Dynamic fields get an instant for each view, since the errors
/// of trajectories are largest at both ends of a clip.
const COMPARED: usize = 12;

/// Number of views for joint rounding.
const ROUNDING: usize = 80;

/// Maximum number of viewpoints that are used with all their steps aside.
const VIEWPOINTS: usize = 2;

/// Number of viewpoints, with one step aside each, where a source has at least so many: the viewpoints of a capture may
/// surround the subject.
const AROUND: usize = 8;

/// Increments of the camera index from picture to picture, since neighbours in the list are neighbours in space. Both
/// are prime: the first that does not divide the number of cameras, at most 24, visits all of them.
const CAMERA_STEPS: [usize; 2] = [7, 5];

/// Size in pixels of the pictures that measure the coding error.
pub(crate) const CODED_SIZE: (u32, u32) = (640, 480);

/// Camera placement: steps aside in degrees, whether the viewpoint itself is used, and rotation of the places where people
/// stand relative to the angle between them.
#[derive(Clone, Copy, Debug)]
struct Places {
    aside: f64,
    viewpoint: bool,
    turn: f64,
}

/// Placement of the steering views.
const STEERING_PLACES: Places = Places { aside: 10.0, viewpoint: false, turn: 0.0 };

/// Placement of the judging views. Only they include the viewpoints themselves, where playing starts.
const JUDGING_PLACES: Places = Places { aside: 6.0, viewpoint: true, turn: 0.5 };

/// Placement of the views that measure what is reported of a selection, of a scene that states no viewpoint, and of rate and
/// distortion; they choose nothing.
const REPORTED_PLACES: Places = Places { aside: 3.0, viewpoint: false, turn: Surroundings::MEASURED_TURN };

/// Placements of the views for joint rounding, and of further views for ranking, apart from the placements of the steering and
/// the judging views.
const FURTHER_PLACES: [Places; 5] = [
    Places { aside: 8.0, viewpoint: false, turn: 0.25 },
    Places { aside: 7.0, viewpoint: false, turn: 0.125 },
    Places { aside: 9.0, viewpoint: false, turn: 0.375 },
    Places { aside: 5.0, viewpoint: false, turn: 0.625 },
    Places { aside: 4.0, viewpoint: false, turn: 0.875 },
];

/// What views show enough of: the field alone where its Gaussians are compared, with the plate where both are coded.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Shown<'a> {
    pub(crate) field: &'a Field,
    pub(crate) plate: Option<&'a Field>,
}

impl<'a> From<&'a Field> for Shown<'a> {
    fn from(field: &'a Field) -> Shown<'a> {
        Shown { field, plate: None }
    }
}

/// Views that rank Gaussians, in small pictures. What none of them shows is ranked last. Another view may show a hole there: a
/// ball in a closed room has 29.4 dB with 7 of 12 Gaussians, and 25.7 dB if the views of the first placement alone rank.
pub(crate) fn ranking_views(scene: &Scene, field: &Field) -> Vec<PosedView> {
    let placements: Vec<Places> = std::iter::once(STEERING_PLACES).chain(FURTHER_PLACES).collect();
    views_of_each(scene, field.into(), &placements, SIZE, STEERING)
}

/// Views that count the fragments of Gaussians, in larger pictures: in small ones the blur makes every small Gaussian
/// large.
pub(crate) fn fragment_views(scene: &Scene, field: &Field) -> Vec<PosedView> {
    views_of(scene, field, STEERING_PLACES, CODED_SIZE, STEERING)
}

/// Views that colours are fitted to, in small pictures: twice as many, so that the colours also fit between them.
pub(crate) fn recolor_views(scene: &Scene, field: &Field) -> Vec<PosedView> {
    views_of(scene, field, STEERING_PLACES, SIZE, 2 * STEERING)
}

/// Views that measure the visibility of coding errors, in pictures of this `size`.
pub(crate) fn visibility_views(scene: &Scene, shown: Shown, size: (u32, u32)) -> Vec<PosedView> {
    views_of(scene, shown, STEERING_PLACES, size, STEERING)
}

/// Views for joint rounding, in small pictures. Rounding fits what it sees: with half as many, the guitar gains 1.5 dB in
/// them and 0.6 dB in others; with these it gains 1.1 dB in others. A static field has few views of one placement, so it
/// gets several.
pub(crate) fn rounding_views(scene: &Scene, field: &Field) -> Vec<PosedView> {
    let placements = if field.temporal.is_some() { &FURTHER_PLACES[..1] } else { &FURTHER_PLACES };
    views_of_each(scene, field.into(), placements, SIZE, ROUNDING / placements.len())
}

/// Views that compare selections with the whole field, in small pictures.
pub(crate) fn judging_views(scene: &Scene, field: &Field) -> Vec<PosedView> {
    views_of(scene, field, JUDGING_PLACES, SIZE, STEERING)
}

/// Views that compare a package with the whole field, in small pictures. The best of many selections is better in the
/// pictures that it was chosen by than in these.
pub(crate) fn whole_views(scene: &Scene, field: &Field) -> Vec<PosedView> {
    views_of(scene, field, REPORTED_PLACES, SIZE, STEERING)
}

/// Views that compare a package with the field before coding, in pictures of this `size`.
pub(crate) fn compared_views(scene: &Scene, shown: Shown, size: (u32, u32)) -> Vec<PosedView> {
    views_of(scene, shown, JUDGING_PLACES, size, COMPARED)
}

/// Views that measure what is reported, in pictures of this `size`; `None` where the source states viewpoints, whose judging
/// views are reported: a user who asks for a quality there reads that it is met.
pub(crate) fn reported_views(scene: &Scene, shown: Shown, size: (u32, u32)) -> Option<Vec<PosedView>> {
    (!scene.states_viewpoints()).then(|| views_of(scene, shown, REPORTED_PLACES, size, COMPARED))
}

/// At most `count` views that measure rate and distortion, in pictures of this `size`.
pub(crate) fn rate_views(scene: &Scene, field: &Field, size: (u32, u32), count: usize) -> Vec<PosedView> {
    views_of(scene, field, REPORTED_PLACES, size, count)
}

/// Seconds between the instants at which Gaussians are looked for from where people stand, and most of these instants.
const UNSEEN_STEP_S: f64 = 0.1;
const UNSEEN_INSTANTS_MAX: f64 = 256.0;

/// The rows of `field`, and of `plate`, that none of [`stand_points`] shows.
pub(super) fn unseen(
    scene: &Scene,
    field: &Field,
    plate: Option<&Field>,
    stand_points: &[Camera],
) -> [Vec<usize>; 2] {
    let count = (f64::from(scene.info.duration_s) / UNSEEN_STEP_S).ceil().clamp(4.0, UNSEEN_INSTANTS_MAX);
    let sights = instants(field, count as usize)
        .into_par_iter()
        .map(|t| CoarseField::sights(field, plate, t, stand_points))
        .reduce(Vec::new, |a, b| match a.is_empty() {
            true => b,
            false => a.into_iter().zip(b).map(|(a, b)| a.max(b)).collect(),
        });
    let (of_field, of_plate) = sights.split_at(field.len());
    [of_field, of_plate].map(|sights| (0..sights.len()).filter(|row| sights[*row] == Sight::Hidden).collect())
}

/// The places where people stand, whether they judge or steer, and the viewpoints.
pub(super) fn stand_points(scene: &Scene) -> Vec<Camera> {
    let info = &scene.info;
    let turned =
        [STEERING_PLACES, JUDGING_PLACES].map(|places| scene.surroundings().stand_points(places.turn, SIZE));
    let mut cameras: Vec<Camera> =
        turned.into_iter().flat_map(|points| [points.content, points.around].concat()).collect();
    cameras.extend(info.viewpoints.iter().map(|viewpoint| viewpoint.camera(info.up, SIZE.0, SIZE.1)));
    cameras
}

/// [`views_of_each`] of one placement.
fn views_of<'a>(
    scene: &Scene,
    shown: impl Into<Shown<'a>>,
    places: Places,
    size: (u32, u32),
    count: usize,
) -> Vec<PosedView> {
    views_of_each(scene, shown.into(), &[places], size, count)
}

/// At most `count` views for each of `placements` that show enough of what is `shown`, half from the source's viewpoints and
/// half from all around. A dynamic field gets an instant for each view, because a few shared instants miss Gaussians
/// that live for a few frames. If no view shows enough, the views of the first placement's last group. Never empty.
fn views_of_each(
    scene: &Scene,
    shown: Shown,
    placements: &[Places],
    size: (u32, u32),
    count: usize,
) -> Vec<PosedView> {
    let groups: Vec<_> = placements.iter().map(|places| camera_groups(scene, *places, size)).collect();
    let mut views: Vec<PosedView> = match shown.field.temporal {
        Some(_) => {
            let instants = instants(shown.field, count * groups.len());
            let view =
                |(i, &t): (usize, &f64)| view_at(&groups[i % groups.len()], shown, t, i / groups.len());
            instants.par_iter().enumerate().filter_map(view).collect()
        }
        None => {
            let shown = CoarseField::new(shown.field, shown.plate, 0.0);
            groups.iter().flat_map(|groups| static_views(groups, &shown, count)).collect()
        }
    };
    if views.is_empty() {
        let around = groups[0].last().expect("the last group is always there");
        let t = instants(shown.field, 1)[0];
        views = around.iter().map(|camera| PosedView { camera: camera.clone(), t }).collect();
        views.truncate(count);
    }
    views
}

/// Names of the source's viewpoints from which players see next to nothing of the scene, at any of a few
/// instants.
pub(crate) fn blind_viewpoints(scene: &Scene) -> Vec<&str> {
    let fields = [Some(&scene.subject), scene.plate.as_ref()].into_iter().flatten().map(|part| &part.field);
    let instants = instants(&scene.subject.field, COMPARED);
    let at_instants: Vec<CoarseField> =
        fields.flat_map(|field| instants.iter().map(move |&t| CoarseField::new(field, None, t))).collect();
    let shows = |camera: &Camera| at_instants.iter().any(|field| field.is_informative(camera));
    let viewpoints = scene.info.viewpoints.iter();
    let blind = viewpoints.filter(|viewpoint| !shows(&viewpoint.camera(scene.info.up, SIZE.0, SIZE.1)));
    blind.map(|viewpoint| viewpoint.name.as_str()).collect()
}

/// The `i`th view of a dynamic field, at `t`: of the next camera of the next group that shows enough then.
fn view_at(groups: &[Vec<Camera>], shown: Shown, t: f64, i: usize) -> Option<PosedView> {
    let field = CoarseField::new(shown.field, shown.plate, t);
    let of_group = |group: &[Camera]| {
        let first = i / groups.len();
        let step = CAMERA_STEPS.into_iter().find(|step| !group.len().is_multiple_of(*step)).unwrap_or(1);
        (0..group.len()).find_map(|k| {
            let camera = &group[(first + k) * step % group.len()];
            field.is_informative(camera).then(|| PosedView { camera: camera.clone(), t })
        })
    };
    (0..groups.len()).find_map(|k| of_group(&groups[(i + k) % groups.len()]))
}

/// At most `count` views of a static `field` that show enough, as many of each group.
fn static_views(groups: &[Vec<Camera>], field: &CoarseField, count: usize) -> Vec<PosedView> {
    let informative = |group: &Vec<Camera>| {
        let cameras = group.par_iter().filter(|camera| field.is_informative(camera));
        cameras.map(|camera| PosedView { camera: camera.clone(), t: 0.0 }).collect::<Vec<PosedView>>()
    };
    let groups: Vec<Vec<PosedView>> =
        groups.iter().map(informative).filter(|group| !group.is_empty()).collect();
    let each = count / groups.len().max(1);
    // Evenly over the group.
    let of_group = |group: &Vec<PosedView>| {
        let taken = each.min(group.len());
        (0..taken).map(|i| group[i * group.len() / taken].clone()).collect::<Vec<PosedView>>()
    };
    groups.iter().flat_map(of_group).collect()
}

/// Cameras for a scene: the cameras of the source's viewpoints, then the cameras of people who stand around the content
/// and elsewhere. If the source states no viewpoint, half of all are the content's. Never empty; the last group is
/// there for every field.
fn camera_groups(scene: &Scene, places: Places, size: (u32, u32)) -> Vec<Vec<Camera>> {
    let StandPoints { content, around } = scene.surroundings().stand_points(places.turn, size);
    if !scene.states_viewpoints() {
        return [around, content].into_iter().filter(|group| !group.is_empty()).collect();
    }
    let up = scene.info.up;
    let viewpoints = &scene.info.viewpoints;
    // The first camera is the viewpoint itself.
    let own = usize::from(!places.viewpoint);
    let steps_aside = |viewpoint| steps_aside(viewpoint, up, places.aside.to_radians(), size).split_off(own);
    let known = match viewpoints.len() {
        ..AROUND => viewpoints.iter().take(VIEWPOINTS).flat_map(steps_aside).collect(),
        many => (0..AROUND).map(|i| steps_aside(&viewpoints[i * many / AROUND]).swap_remove(0)).collect(),
    };
    vec![known, [content, around].concat()]
}

pub(crate) fn render_scene<'a>(field: &'a Field, plate: Option<&'a Field>) -> RenderScene<'a> {
    let scene = RenderScene::from(field);
    plate.map_or(scene.clone(), |plate| scene.with_plate(plate))
}

#[cfg(test)]
mod tests {
    use super::*;
    use codec::{ClipInfo, Viewpoint};

    /// A Gaussian in the middle of a ring of viewpoints.
    fn ring(count: usize) -> Scene {
        let field = Field {
            centers: vec![[0.0; 3]],
            rotations: vec![[1.0, 0.0, 0.0, 0.0]],
            log_scales: vec![[-1.0; 3]],
            opacities: vec![1.0],
            sh_degree: 0,
            sh: vec![[0.0; 3]],
            ..Field::default()
        };
        let viewpoint = |i: usize| {
            let (sin, cos) = (std::f32::consts::TAU * i as f32 / count as f32).sin_cos();
            let position = [3.0 * sin, 1.0, 3.0 * cos];
            Viewpoint { name: i.to_string(), position, target: [0.0; 3], fov_y: 0.8 }
        };
        let viewpoints = (0..count).map(viewpoint).collect();
        let info = ClipInfo { up: [0.0, 1.0, 0.0], viewpoints, ..ClipInfo::default() };
        Scene::made("ring", field, info)
    }

    fn ring_views(scene: &Scene, places: Places) -> Vec<PosedView> {
        views_of(scene, &scene.subject.field, places, SIZE, STEERING)
    }

    #[test]
    fn a_ring_is_seen_from_all_its_sides_and_from_other_places_by_the_judge() {
        let scene = ring(16);
        let [steering, judging] = [STEERING_PLACES, JUDGING_PLACES].map(|places| ring_views(&scene, places));
        // As many of the ring as from around.
        assert_eq!((steering.len(), judging.len()), (2 * AROUND, 2 * AROUND));
        for views in [&steering, &judging] {
            let x = views[..AROUND].iter().map(|view| view.camera.position()[0]).sum::<f64>();
            assert!(x.abs() < 1e-4, "{x}");
        }
        let position = |view: &PosedView| view.camera.position();
        assert!(steering.iter().all(|view| judging.iter().all(|other| position(other) != position(view))));
        assert_eq!(judging[0].camera, scene.info.viewpoints[0].camera(scene.info.up, SIZE.0, SIZE.1));
    }

    #[test]
    fn views_that_steer_rank_round_judge_and_report_are_apart() {
        let mut scene = ring(16);
        for is_dynamic in [false, true] {
            let temporal = codec::Temporal { tau: vec![0.5], s: vec![0.4], ..Default::default() };
            scene.subject.field.temporal = is_dynamic.then_some(temporal);
            let field = &scene.subject.field;
            let rounding = rounding_views(&scene, field);
            let expected = if is_dynamic { ROUNDING } else { 2 * AROUND * FURTHER_PLACES.len() };
            assert_eq!(rounding.len(), expected);
            let position = |view: &PosedView| view.camera.position();
            let roles = [
                &rounding,
                &visibility_views(&scene, field.into(), SIZE),
                &compared_views(&scene, field.into(), SIZE),
                &whole_views(&scene, field),
            ];
            for (i, views) in roles.iter().enumerate() {
                for others in &roles[..i] {
                    assert!(others.iter().all(|a| views.iter().all(|b| position(a) != position(b))));
                }
            }
            let reported: Vec<_> = whole_views(&scene, field).iter().map(position).collect();
            let rated = rate_views(&scene, field, SIZE, STEERING);
            assert!(rated.iter().all(|view| reported.contains(&position(view))), "rates are reported");
            let ranking = ranking_views(&scene, field);
            let of_placement = if is_dynamic { STEERING } else { 2 * AROUND };
            assert_eq!(ranking.len(), of_placement * (1 + FURTHER_PLACES.len()));
            for judge in judging_views(&scene, field).iter().chain(&whole_views(&scene, field)) {
                assert!(ranking.iter().all(|view| position(view) != position(judge)));
            }
            for views in [&rounding, &ranking] {
                let mut positions: Vec<_> = views.iter().map(|view| (position(view), view.t)).collect();
                positions.sort_by(|a, b| a.partial_cmp(b).unwrap());
                positions.dedup();
                assert_eq!(positions.len(), views.len(), "each view is another one");
            }
        }
    }

    #[test]
    fn a_dynamic_field_has_an_instant_for_each_view_and_all_sides_in_a_row() {
        let mut scene = ring(16);
        let (tau, s) = (vec![0.5], vec![0.4]);
        scene.subject.field.temporal = Some(codec::Temporal { tau, s, ..Default::default() });
        let views = visibility_views(&scene, (&scene.subject.field).into(), SIZE);
        assert_eq!(views.len(), STEERING);
        assert!(views.windows(2).all(|pair| pair[0].t < pair[1].t));
        let known: Vec<f64> = views.iter().step_by(2).map(|view| view.camera.position()[0]).collect();
        for eight in known.windows(AROUND) {
            let x = eight.iter().sum::<f64>();
            assert!(x.abs() < 1e-4, "{x}");
        }
    }

    /// Rows all over a ball of this `radius`, each of this `scale`.
    fn shell(rows: usize, radius: f64, scale: f64, field: &mut Field) {
        for row in 0..rows {
            let height = 1.0 - (2 * row + 1) as f64 / rows as f64;
            let (sin, cos) = libm::sincos(2.399_963 * row as f64);
            let level = (1.0 - height * height).sqrt();
            field.centers.push([level * cos, height, level * sin].map(|x| (radius * x) as f32));
            field.log_scales.push([libm::log(scale) as f32; 3]);
        }
        field.rotations = vec![[1.0, 0.0, 0.0, 0.0]; field.len()];
        field.opacities = vec![0.9; field.len()];
        field.sh = vec![[0.5; 3]; field.len()];
    }

    #[test]
    fn a_few_rows_of_a_far_sky_take_no_view_away_from_the_content() {
        let distances = |sky: usize| {
            let mut field = Field::default();
            shell(1000, 1.0, 0.1, &mut field);
            shell(sky, 100.0, 30.0, &mut field);
            let viewpoints = ring(1).info.viewpoints;
            let info = ClipInfo { up: [0.0, 1.0, 0.0], viewpoints, ..ClipInfo::default() };
            let views = ring_views(&Scene::made("under a sky", field, info), STEERING_PLACES);
            let position = |view: &PosedView| view.camera.position();
            let distance = |[x, y, z]: [f64; 3]| (x * x + y * y + z * z).sqrt();
            let near = views.iter().map(position).map(distance).filter(|&distance| distance < 10.0).count();
            (near, views.len())
        };
        let (alone, views) = distances(0);
        assert_eq!(alone, views);
        assert!(distances(100).0 >= alone, "{:?}", distances(100));
    }

    /// An object before a wall that surrounds it: looks at the wall alone count where it is coded.
    #[test]
    fn a_plate_is_coded_by_what_views_show_of_it() {
        let [mut object, mut wall] = [Field::default(), Field::default()];
        shell(1000, 1.0, 0.1, &mut object);
        shell(1000, 10.0, 0.6, &mut wall);
        let mut scene = Scene::made("before a wall", object, ClipInfo::default());
        scene.plate = Some(formats::Imported::new("made up", wall, formats::Repairs::default()));
        let field = &scene.subject.field;
        let plate = scene.plate.as_ref().map(|plate| &plate.field);
        let away = |views: &[PosedView]| {
            let alone = CoarseField::new(field, None, 0.0);
            views.iter().filter(|view| !alone.is_informative(&view.camera)).count()
        };
        let shown = Shown { field, plate };
        assert_eq!(away(&ranking_views(&scene, field)), 0);
        for views in [
            visibility_views(&scene, shown, SIZE),
            compared_views(&scene, shown, SIZE),
            reported_views(&scene, shown, SIZE).expect("no viewpoint is stated"),
        ] {
            assert!((1..views.len()).contains(&away(&views)), "{} of {}", away(&views), views.len());
        }
    }

    #[test]
    fn views_that_show_nothing_do_not_count() {
        let mut scene = ring(2);
        assert!(blind_viewpoints(&scene).is_empty());
        // One viewpoint looks away.
        let away = &mut scene.info.viewpoints[1];
        away.target = away.position.map(|x| 2.0 * x);
        assert_eq!(blind_viewpoints(&scene), ["1"]);
        let views = ring_views(&scene, JUDGING_PLACES);
        assert_eq!(views.len(), 5 + AROUND);
        scene.info.viewpoints.remove(0);
        assert_eq!(ring_views(&scene, JUDGING_PLACES).len(), AROUND, "only from around");
        let mut nothing = ring(2);
        nothing.subject.field.opacities[0] = 0.0;
        assert_eq!(ring_views(&nothing, JUDGING_PLACES).len(), AROUND, "nothing to see: from around");
    }
}

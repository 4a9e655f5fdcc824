//! [`package`]: the stages of packaging, one after another.

use codec::Field;
use program::Fault;
use refine::code::Miss;
use refine::fit::{Backend, Cpu};

use super::analysis::{rankings, selecting};
use super::choose::choose;
use super::encode::{VerifiedPackage, encode, explain};
use super::lens_fragments::lens_fragments;
use super::report::{PackageReport, Shortfall, WorstView};
use super::settings::{Coding, LAYERS, PackageSettings};
use super::views::{stand_points, unseen};
use super::visible::{VisibleScene, visible_scene};
use crate::fit::{Refinement, RefinementReport};
use crate::progress::StagedProgress;
use crate::scene::Scene;

/// Refinement steps per progress step.
const STEPS_PER_PROGRESS: u64 = 16;

/// A finished package.
#[derive(Debug)]
pub struct Package {
    /// The contents of the file.
    pub bytes: Vec<u8>,
    /// What went into it.
    pub report: PackageReport,
}

/// Makes a package.
///
/// The same scene and settings give the same bytes, on any number of threads.
///
/// # Errors
/// [`program::Fault::Data`] where no Gaussian is visible, numbers cannot be coded, or `strict` refuses a
/// repair. Any other error is a defect of this program.
pub fn package(scene: &Scene, settings: &PackageSettings) -> anyhow::Result<Package> {
    package_with(scene, settings, None, &mut Cpu::default(), &StagedProgress::hidden())
}

/// Makes a package as [`package`] does, refines the retained Gaussians on photographs,
/// and draws `progress`. `backend` computes the gradients of refining and of joint rounding. With a graphics device, the
/// package is marked, for another may give other bytes.
///
/// # Errors
/// As [`package`]; [`program::Fault::Device`] if the device fails.
pub fn package_with(
    scene: &Scene,
    settings: &PackageSettings,
    refinement: Option<&Refinement>,
    backend: &mut dyn Backend,
    progress: &StagedProgress,
) -> anyhow::Result<Package> {
    let VisibleScene { field, mut subject, plate, plate_counts, parts_removed } =
        visible_scene(scene, settings)?;
    progress.plan(plan(settings, field.len(), refinement));
    let mut choice = choose(scene, &field, plate.as_ref(), settings, progress)?;
    let refine = |refinement| refine_field(&mut choice.field, refinement, backend, progress);
    let refined = refinement.map(refine).transpose()?;
    let VerifiedPackage { coded, snapped, steering_views, rounding_views, judging_views, reported } =
        encode(scene, &choice.field, plate.as_ref(), settings.coding, backend, progress)?;
    progress.stage("counting fragments", 1);
    let lens_fragments = lens_fragments(scene, &field, plate.as_ref(), &coded.clip);
    progress.stage("comparing with the whole", 1);
    let whole_psnr_db = choice.whole_psnr_db(&coded.clip);
    progress.stage("looking for what nobody sees", 1);
    let unseen = unseen(scene, &choice.field, plate.as_ref(), &stand_points(scene));
    progress.finish();
    subject.keep(choice.field.len(), settings.budget);
    let report = PackageReport {
        subject,
        plate: plate_counts,
        parts_removed,
        ranking: choice.ranking.name(),
        layer_ranking: choice.layer_ranking.name(),
        tried_orders: choice.tried_orders,
        topology: choice.topology,
        whole_psnr_db,
        tried: choice.tried,
        why: choice.why,
        snapped,
        recolor_gain_db: choice.recolor_gain_db,
        refined,
        unseen: unseen.iter().map(Vec::len).sum(),
        layers: coded.clip.layers.iter().map(|end| end.total()).collect(),
        lens_fragments,
        duration_s: scene.info.duration_s,
        assumed: scene.assumed.clone(),
        bytes: coded.bytes.len(),
        coder: settings.coding.name(),
        self_psnr_db: reported.psnr_db,
        covered_psnr_db: reported.covered_psnr_db,
        worst_view: reported.worst.as_ref().map(|worst| WorstView::new(worst, &scene.info)),
        bytes_alone: coded.bytes_alone,
        steering_views,
        rounding_views,
        judging_views,
        miss: settings.coding.quality_db().zip(coded.miss).map(|(quality_db, miss)| Shortfall {
            is_below: miss == Miss::Below,
            text: explain(miss, quality_db, &coded.fidelity),
        }),
    };
    Ok(Package { bytes: coded.bytes, report })
}

/// The stages of packaging `rows` Gaussians with their work: seconds of a film of 68,000 Gaussians on two cores.
fn plan(settings: &PackageSettings, rows: usize, refinement: Option<&Refinement>) -> Vec<(String, f64)> {
    let rankings = rankings(settings);
    let budget = settings.budget.filter(|&budget| budget < rows);
    let mut plan = Vec::new();
    let mut add = |stage: &str, work: f64| plan.push((stage.to_owned(), work));
    let is_judged = budget.is_some() || settings.fragments.is_some();
    if rankings.iter().any(|ranking| ranking.looks_at_pictures()) && (is_judged || settings.rank.is_some()) {
        add("ranking", 18.0);
    }
    if is_judged {
        add("pictures of the whole", 2.0);
        add("topology of the whole", 0.5);
    }
    if let Some(budget) = budget {
        rankings.iter().for_each(|&ranking| add(&selecting(ranking), 2.5));
        let prefixes = LAYERS.into_iter().filter(|&end| end < budget).count() * rankings.len();
        if rankings.len() > 1 && prefixes > 0 {
            add("layers", prefixes as f64);
        }
    }
    if settings.fragments.is_some() {
        add("fragments", 3.0);
    }
    if settings.recolor && is_judged {
        add("colours", 20.0);
    }
    if let Some(refinement) = refinement {
        add("refining", 0.1 * refinement.steps as f64);
    }
    add("pictures to code by", 1.5);
    add("snapping", 2.0);
    if let Coding::ToQuality { joint_rounds, .. } = settings.coding {
        add("coding", 8.0 + 7.0 * joint_rounds as f64);
    }
    add("reporting", 1.5);
    add("counting fragments", 3.0);
    if is_judged {
        add("comparing with the whole", 3.0);
    }
    add("looking for what nobody sees", 2.0);
    plan
}

/// Refines `field` on the photographs; its rows stay in order.
fn refine_field(
    field: &mut Field,
    refinement: &Refinement,
    backend: &mut dyn Backend,
    progress: &StagedProgress,
) -> Result<RefinementReport, Fault> {
    progress.stage("refining", (refinement.steps / STEPS_PER_PROGRESS) as usize);
    let mut steps = 0;
    let on_step = || {
        steps += 1;
        if steps % STEPS_PER_PROGRESS == 0 {
            progress.step();
        }
    };
    let refined = refinement.run(field, backend, on_step);
    let (refined, report) = refined.map_err(|error| Fault::Device(error.to_string()))?;
    *field = refined;
    Ok(report)
}

#[cfg(test)]
mod tests {
    use codec::{Camera, ClipInfo, Limits};
    use formats::{Imported, Repairs};
    use refine::prune::{Pictures, Ranking};
    use refine::reference::PosedView;
    use refine::reference::RenderScene;

    use super::*;
    use crate::package::settings::{DropPart, QUALITY_DB};
    use crate::package::views::reported_views;

    /// Rows of the ball, and as many of the room.
    const COUNT: usize = 1500;

    /// A ball of radius 1 in a closed room of radius 10.
    fn ball_in_a_room() -> Field {
        ball_within(10.0, -1.0)
    }

    /// A ball of radius 1 within a sphere of this radius, from this share of the radius upwards; y points down.
    fn ball_within(sphere: f64, bottom: f64) -> Field {
        let mut state = 7u64;
        let mut random = move || {
            state = state.wrapping_mul(6364136223846793005).wrapping_add(1442695040888963407);
            (state >> 11) as f64 / (1u64 << 53) as f64
        };
        let mut field = Field::default();
        for row in 0..2 * COUNT {
            let is_ball = row < COUNT;
            let (radius, scale) =
                if is_ball { (libm::cbrt(random()), 0.06) } else { (sphere, 0.06 * sphere) };
            let y = if is_ball { 2.0 * random() - 1.0 } else { -bottom - (1.0 - bottom) * random() };
            let (sin, cos) = libm::sincos(std::f64::consts::TAU * random());
            let level = (1.0 - y * y).sqrt();
            let at = [level * cos, y, level * sin];
            field.centers.push(at.map(|x| (radius * x) as f32));
            // Neighbours have like colours, so that it matters little which of two at one depth is drawn first.
            field.sh.push(at.map(|x| (x + 0.2 * random()) as f32));
            field.log_scales.push([libm::log(scale) as f32; 3]);
        }
        field.rotations = vec![[1.0, 0.0, 0.0, 0.0]; field.len()];
        field.opacities = vec![0.9; field.len()];
        field
    }

    #[test]
    fn rooms_and_skies_without_a_viewpoint_are_packaged_for_who_stands_in_them() {
        for (sphere, bottom, distance) in
            [(10.0, -1.0, 1.2), (100.0, -1.0, 1.2), (30.0, 0.0, 3.5), (100.0, 0.0, 3.5)]
        {
            check_from_within(ball_within(sphere, bottom), distance);
        }
    }

    /// The ball comes and goes, and moves by a tenth of its radius.
    #[test]
    fn what_moves_in_a_room_is_packaged_for_who_stands_there() {
        let motion = |row: usize| if row < COUNT { [0.1, 0.0, 0.05] } else { [0.0; 3] };
        let temporal = codec::Temporal {
            tau: vec![0.5; 2 * COUNT],
            s: (0..2 * COUNT).map(|row| if row < COUNT { 0.6 } else { f32::INFINITY }).collect(),
            motion_order: 1,
            motion: (0..2 * COUNT).map(motion).collect(),
            ..Default::default()
        };
        for sphere in [10.0, 100.0] {
            let field = Field { temporal: Some(temporal.clone()), ..ball_within(sphere, -1.0) };
            check_from_within(field, 1.2);
        }
    }

    #[test]
    fn a_part_of_a_take_has_the_viewpoints_of_the_take() {
        let viewpoint = |size: f32| codec::Viewpoint::framing([[-size; 3], [size; 3]], [0.0, -1.0, 0.0]);
        let info = ClipInfo { viewpoints: vec![viewpoint(1.0)], ..ClipInfo::default() };
        let part = || Scene::made("part", ball_in_a_room(), info.clone());
        let surroundings = std::sync::Arc::clone(part().surroundings());
        let of_take = [viewpoint(2.0)];
        let stated = part().in_take(&surroundings, &of_take, true);
        assert!(stated.states_viewpoints() && stated.info.viewpoints == of_take);
        let assumed = part().in_take(&surroundings, &of_take, false);
        assert!(!assumed.states_viewpoints() && assumed.info.viewpoints == of_take);
    }

    /// Packages a field, and looks at it from this distance of its middle.
    fn check_from_within(field: Field, distance: f64) {
        let scene = Scene::made("room", field, ClipInfo::default());
        let (report, clip) = packaged(&scene, None);
        let psnr_db = psnr_within(&scene, &clip, distance);
        assert!(psnr_db >= 44.0, "{psnr_db:.1} dB, and {:.1} dB are reported", report.self_psnr_db);
        // Of what moves, other instants count.
        let below_db = if scene.subject.field.temporal.is_some() { 4.0 } else { 1.0 };
        assert!(
            (-below_db..1.0).contains(&(report.self_psnr_db - psnr_db)),
            "{psnr_db:.1} {:.1}",
            report.self_psnr_db
        );
        assert!(report.unseen < COUNT, "only in the ball: {}", report.unseen);
    }

    fn packaged(scene: &Scene, budget: Option<usize>) -> (PackageReport, codec::Clip) {
        let coding = Coding::ToQuality { quality_db: QUALITY_DB, joint_rounds: 0 };
        let settings = PackageSettings { coding, budget, ..PackageSettings::default() };
        let Package { bytes, report } = package(scene, &settings).unwrap();
        (report, codec::decode(&bytes, &Limits::default()).unwrap())
    }

    /// PSNR in dB of a clip against its scene, from this distance of the middle.
    fn psnr_within(scene: &Scene, clip: &codec::Clip, distance: f64) -> f64 {
        let view = |i: u32| {
            let (sin, cos) = libm::sincos(f64::from(i) * 1.3);
            let [position, up] = [[distance * cos, 0.2, distance * sin], [0.0, -1.0, 0.0]];
            let t = f64::from(i) / 3.0;
            PosedView { camera: Camera::look_at(position, [0.0; 3], up, 0.9, 160, 120), t }
        };
        let whole = RenderScene::from(&scene.subject.field);
        let pictures = Pictures::take(&whole, (0..4).map(view).collect(), || ());
        pictures.psnr(&RenderScene::from(clip), || ())
    }

    #[test]
    fn a_budget_keeps_of_a_room_and_what_is_in_it_what_people_see() {
        for sphere in [10.0, 100.0] {
            let scene = Scene::made("room", ball_within(sphere, -1.0), ClipInfo::default());
            let (report, clip) = packaged(&scene, Some(COUNT + COUNT / 6));
            let radius = |center: &[f32; 3]| center.iter().map(|x| x * x).sum::<f32>().sqrt();
            let fields = [&clip.static_field, &clip.dynamic_field];
            let centers = fields.iter().flat_map(|field| &field.centers);
            let ball = centers.filter(|center| radius(center) < 2.0).count();
            let whole_db = report.whole_psnr_db.expect("rows are left out");
            let within = [1.2, 1.5, 2.0, 3.0].map(|distance| psnr_within(&scene, &clip, distance));
            println!("{sphere}: {ball} rows of the ball, {whole_db:.1} dB reported, {within:.1?} seen");
            // Other rows of the ball are hidden within it.
            assert!((COUNT / 3..COUNT / 2).contains(&ball), "{sphere}: {ball} rows of the ball");
            for psnr_db in within {
                assert!(
                    (whole_db - psnr_db).abs() < 2.5 && psnr_db > 27.0,
                    "{sphere}: {within:.1?} {whole_db:.1}"
                );
            }
        }
    }

    /// Under a thin sky, and with one Gaussian far away.
    #[test]
    fn what_is_far_away_chooses_no_ranking() {
        for (far, rows) in [(100.0, 100), (1000.0, 100), (100.0, 1), (1000.0, 1)] {
            let mut field = ball_within(far, 0.0).select(&(0..COUNT + rows).collect::<Vec<_>>());
            for row in 0..COUNT {
                let [a, b] = [7, 11].map(|step| (row * step % 17) as f32 / 17.0);
                field.opacities[row] = 0.1 + 0.85 * a;
                field.log_scales[row] = [0.03f32.ln() + 1.4 * b; 3];
            }
            let scene = Scene::made("far", field, ClipInfo::default());
            let reported = |rank: Option<Ranking>| {
                let budget = Some(COUNT / 3);
                let settings =
                    PackageSettings { coding: Coding::Fixed, budget, rank, ..PackageSettings::default() };
                let PackageReport { ranking, whole_psnr_db, .. } = package(&scene, &settings).unwrap().report;
                (whole_psnr_db.expect("rows are left out"), ranking)
            };
            let (chosen_db, ranking) = reported(None);
            let each = Ranking::ALL.map(|ranking| reported(Some(ranking)));
            let best_db = each.iter().map(|(psnr_db, _)| *psnr_db).fold(0.0, f64::max);
            assert!(chosen_db > best_db - 0.3, "{rows} at {far}: {ranking}, {chosen_db:.2} of {each:.2?}");
        }
    }

    #[test]
    fn what_nobody_sees_is_dropped_on_request_and_no_picture_changes() {
        let mut field = ball_in_a_room();
        field.log_scales[..COUNT].fill([libm::log(0.12) as f32; 3]);
        let scene = Scene::made("room", field, ClipInfo::default());
        let settings = PackageSettings { drop: vec![DropPart::Unseen], ..PackageSettings::default() };
        let VisibleScene { field, subject, .. } = visible_scene(&scene, &settings).unwrap();
        let dropped = subject.dropped.values().sum::<usize>();
        assert!((COUNT / 10..COUNT).contains(&dropped), "only in the ball: {dropped}");
        assert_eq!(field.len() + dropped, 2 * COUNT);
        let views = reported_views(&scene, (&field).into(), (256, 192)).expect("no viewpoint is stated");
        let pictures = Pictures::take(&RenderScene::from(&scene.subject.field), views, || ());
        let psnr_db = pictures.psnr(&RenderScene::from(&field), || ());
        assert!(psnr_db > 70.0, "{psnr_db}");

        // The ball as the background of the room.
        let whole = &scene.subject.field;
        let part = |rows: std::ops::Range<usize>| whole.select(&rows.collect::<Vec<_>>());
        let mut of_parts = Scene::made("parts", part(COUNT..2 * COUNT), ClipInfo::default());
        of_parts.plate = Some(Imported::new("made up", part(0..COUNT), Repairs::default()));
        let VisibleScene { field, plate, plate_counts, .. } = visible_scene(&of_parts, &settings).unwrap();
        let (plate, counts) = (plate.expect("it is visible"), plate_counts.expect("it is counted"));
        assert_eq!(field.len(), COUNT, "the room is seen");
        assert_eq!(counts.dropped.values().sum::<usize>(), COUNT - plate.len());
        assert_eq!(counts.gaussians_out, plate.len());
        assert!((COUNT / 10..COUNT).contains(&plate.len()), "{} of the ball", plate.len());
    }

    /// A case around the ball is gone for a tenth of a second, three times.
    #[test]
    fn what_is_seen_for_a_moment_is_kept() {
        let mut field = ball_in_a_room();
        let unit = |x: &[f32; 3]| x.map(|x| 0.1 * x);
        let case: Vec<[f32; 3]> = field.centers[COUNT..].iter().map(unit).collect();
        field.centers[..COUNT].iter_mut().for_each(|center| *center = center.map(|x| 0.5 * x));
        field.centers[COUNT..].copy_from_slice(&case);
        field.log_scales[COUNT..].fill([libm::log(0.15) as f32; 3]);
        let dropped = |field: Field| {
            let scene = Scene::made("case", field, ClipInfo { duration_s: 1.0, ..ClipInfo::default() });
            let settings = PackageSettings { drop: vec![DropPart::Unseen], ..PackageSettings::default() };
            visible_scene(&scene, &settings).unwrap().subject.dropped.values().sum::<usize>()
        };
        let closed = dropped(field.clone());
        assert!(closed > COUNT * 9 / 10, "{closed}");
        // The case is there at four instants, and gone between them.
        let case = || COUNT..2 * COUNT;
        let rows: Vec<usize> = (0..COUNT).chain((0..4).flat_map(|_| case())).collect();
        let mut field = field.select(&rows);
        let life = |row: usize| match row.checked_sub(COUNT) {
            None => (0.5, 100.0),
            Some(of_case) => (0.125 + 0.25 * (of_case / COUNT) as f32, 0.036),
        };
        let (tau, s) = (0..field.len()).map(life).unzip();
        field.temporal = Some(codec::Temporal { tau, s, ..Default::default() });
        let open = dropped(field);
        assert!(open < closed / 2, "{open} of {closed}");
    }
}

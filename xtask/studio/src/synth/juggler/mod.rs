//! The demo scene: a juggler in a circus ring, three seconds that loop.
//!
//! The figure is a signed distance function in its rest pose (`figure`). Its
//! surface is covered with flat Gaussians (`sample`), which follow the bones of an articulated
//! body (`skeleton`) that plays a three-ball cascade (`cascade`). Each Gaussian's motion is
//! then fitted by polynomials in as few windows as possible (`fit`): one for parts that only sway,
//! a dozen or more for hands and balls. The ring and its objects are static, except for flags in a breeze
//! (`ring`).
//! Shading is baked into the colours (`light`).
//!
//! Axes: y up, the floor at y = 0, the juggler faces +z, his left is +x. Units: metres.

mod cascade;
mod figure;
mod fit;
mod light;
mod ring;
mod sample;
mod sdf;
mod skeleton;

use std::f64::consts::PI;

use codec::{ClipInfo, Field, Viewpoint};
use glam::{DQuat, DVec3, dvec3};

use cascade::Cascade;
use figure::Figure;
use fit::{Gaussians, Surfel, SurfelPose, Windows};
use light::Light;
use sample::Sample;
use skeleton::Pose;

/// Length of the clip in seconds: three turns of each hand, after which every ball is back.
const DURATION_S: f64 = 3.0;

/// Frames per second in the clip's metadata.
const FPS: f32 = 30.0;

/// Numbers of windows; each Gaussian takes the smallest that follows its motion. Multiples of the three
/// turns of the hands.
const WINDOWS: [usize; 5] = [6, 9, 12, 15, 18];

/// Number of pieces of surface on a ball.
const BALL_SURFELS: u32 = 90;

/// Makes the field and its metadata.
pub fn clip() -> (Field, ClipInfo) {
    let cascade = Cascade::new();
    let rest = skeleton::pose(0.0, cascade.rest());
    let figure = Figure::new(&rest);
    let solid = |p| figure.distance(p).min(ring::distance(p));
    let light = Light::new(&solid);
    let mut gaussians = Gaussians::default();
    ring::build(&light, &mut gaussians);
    let windows: Vec<Windows> =
        std::iter::once(Windows::whole()).chain(WINDOWS.iter().map(|&k| Windows::periodic(k))).collect();
    let poses = |t: f64| skeleton::pose(cascade::sway(t), cascade.hands(t));
    add_figure(&figure, &rest, &poses, &windows, &light, &mut gaussians);
    for ball in 0..cascade::BALLS {
        add_ball(ball, &cascade, &windows, &light, &mut gaussians);
    }
    (gaussians.into_field(), info())
}

/// Covers the figure with Gaussians that follow its bones.
fn add_figure(
    figure: &Figure,
    rest: &Pose,
    poses: &dyn Fn(f64) -> Pose,
    windows: &[Windows],
    light: &Light,
    gaussians: &mut Gaussians,
) {
    // The bones' motions at all fitted instants.
    let motions: Vec<Vec<Vec<skeleton::Motion>>> = windows
        .iter()
        .map(|windows| {
            let at = |t: f64| skeleton::motion(rest, &poses(t));
            windows.instants().map(|window| window.map(at).collect()).collect()
        })
        .collect();
    for Sample { point, normal, spacing } in figure.samples() {
        let skin = figure.skin(point);
        let shade = light.occlusion(point, normal);
        let albedo = figure.paint(point, normal);
        let place = |set: usize, window: usize, instant: usize| {
            let (rotation, position) = skeleton::skinned(&motions[set][window][instant], &skin, point);
            SurfelPose { position, rotation }
        };
        let surfel = Surfel { normal, spacing, color: &|n| light.color(albedo, n, shade) };
        gaussians.push_fitted(&surfel, windows, &place);
    }
}

/// A ball and its shadow on the floor.
fn add_ball(ball: usize, cascade: &Cascade, windows: &[Windows], light: &Light, gaussians: &mut Gaussians) {
    let at = |t: f64| (cascade.ball(ball, t), cascade.rotation(ball, t));
    let motions: Vec<Vec<Vec<(DVec3, DQuat)>>> = windows
        .iter()
        .map(|windows| windows.instants().map(|window| window.map(at).collect()).collect())
        .collect();
    let spacing = cascade::BALL_RADIUS * (4.0 * PI / f64::from(BALL_SURFELS)).sqrt();
    for normal in sample::fibonacci_sphere(BALL_SURFELS) {
        let albedo = cascade::paint(ball, normal);
        let place = |set: usize, window: usize, instant: usize| {
            let (center, rotation) = motions[set][window][instant];
            SurfelPose { position: center + rotation * normal * cascade::BALL_RADIUS, rotation }
        };
        let surfel = Surfel { normal, spacing, color: &|n| light.color(albedo, n, light::OPEN) };
        gaussians.push_fitted(&surfel, windows, &place);
    }
    let shadow = |set: usize, window: usize, instant: usize| {
        let (center, _) = motions[set][window][instant];
        SurfelPose { position: light.on_floor(center), rotation: DQuat::IDENTITY }
    };
    gaussians.push_shadow(0.05, 0.35, windows, &shadow);
}

fn info() -> ClipInfo {
    let view = |name: &str, position: DVec3, target: DVec3, fov_y_deg: f32| Viewpoint {
        name: name.into(),
        position: position.as_vec3().into(),
        target: target.as_vec3().into(),
        fov_y: fov_y_deg.to_radians(),
    };
    ClipInfo {
        duration_s: DURATION_S as f32,
        fps: FPS,
        up: [0.0, 1.0, 0.0],
        metres_per_unit: 1.0,
        viewpoints: vec![
            view("front", dvec3(0.5, 1.45, 3.3), dvec3(0.0, 0.95, 0.0), 42.0),
            view("side", dvec3(2.8, 1.35, 1.75), dvec3(0.0, 0.95, 0.0), 42.0),
            view("close-up", dvec3(-0.35, 1.5, 1.55), dvec3(0.0, 1.33, 0.1), 40.0),
            view("top", dvec3(0.0, 3.9, 1.6), dvec3(0.0, 0.6, 0.05), 42.0),
        ],
    }
}

#[cfg(test)]
mod tests {
    use refine::reference::{Order, render};

    use super::*;

    #[test]
    fn the_clip_keeps_its_promises() {
        let (field, info) = clip();
        field.check().unwrap();
        assert!((30_000..45_000).contains(&field.len()), "{} Gaussians", field.len());
        let temporal = field.temporal.as_ref().unwrap();
        let static_count =
            (0..field.len()).filter(|&i| temporal.s[i].is_infinite() && temporal.is_motionless(i)).count();
        assert!(static_count > 4_000, "{static_count} never move");
        // The end of the clip looks like its start.
        let camera = info.viewpoints[0].camera(info.up, 240, 240);
        let at = |t: f64| render(&(&field).into(), &camera, t, Order::Depth);
        let (start, end, later) = (at(0.0), at(1.0), at(0.1));
        assert!(start.psnr(&end) > 45.0, "{} dB", start.psnr(&end));
        assert!(start.psnr(&later) < 30.0, "he moves");
    }

    #[test]
    fn balls_are_where_the_cascade_has_them() {
        let cascade = Cascade::new();
        let solid = |_: DVec3| 1.0;
        let light = Light::new(&solid);
        let windows: Vec<Windows> = WINDOWS.iter().map(|&k| Windows::periodic(k)).collect();
        for ball in 0..cascade::BALLS {
            let mut gaussians = Gaussians::default();
            add_ball(ball, &cascade, &windows, &light, &mut gaussians);
            let field = gaussians.into_field();
            for step in 0..60 {
                let t = f64::from(step) / 59.0;
                let mut sum = DVec3::ZERO;
                let mut weight = 0.0;
                // All but the shadow, which is the only part on the floor.
                for i in 0..field.len() {
                    let p = DVec3::from_array(field.position_at(i, t));
                    if p.y > 0.2 {
                        sum += p * field.opacity_at(i, t);
                        weight += field.opacity_at(i, t);
                    }
                }
                let away = (sum / weight - cascade.ball(ball, t)).length();
                assert!(away < 0.012, "ball {ball} is {away} m away at {t}");
                let layers = weight / f64::from(BALL_SURFELS);
                assert!((1.15..1.35).contains(&layers), "ball {ball} has {layers} layers at {t}");
            }
        }
    }
}

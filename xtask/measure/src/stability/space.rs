//! Stiff in space: scales from 1e-8 to 1e6 of the scene, needles, and Gaussians around the eye, far away, or at the
//! limits of the view.

use codec::{Field, PixelFilter};

use super::gaussians::{Gaussian, crowd, field, normalized, static_crowd};
use refine::reference::PosedView;

use super::case::{DISTANCE, StabilityCase, StabilityScene, at, case, look};

const GROUP: &str = "stiff in space";

/// The middle of the clip: most cases are static.
const T: [f64; 1] = [0.5];

// Long: a table of cases.
pub(super) fn cases() -> Vec<StabilityCase> {
    vec![
        case(
            GROUP,
            "scales from 1e-8 to 1e6 of the scene",
            2.0,
            "log-scales in 16 bits of their range; 0.3 px^2 of blur; quads end at the image",
            || {
                let row = |k: i32| {
                    let center = [0.2 * (k + 1) as f32, 0.1 * (k % 3) as f32, 0.05 * k as f32];
                    Gaussian { center, opacity: 0.3, ..Gaussian::default() }.sized([10f32.powi(k); 3])
                };
                let rows: Vec<Gaussian> = (-8..=6).map(row).collect();
                StabilityScene::new(field(&[rows, static_crowd(20)].concat()), at(&T))
            },
        ),
        case(
            GROUP,
            "scales beyond 5e8 and below 2e-9 units",
            2.0,
            "limited to e^20 and e^-20 when packed",
            || {
                let rows = |limit: f32| {
                    let scaled =
                        |x: f32| Gaussian { log_scales: [x.clamp(-limit, limit); 3], ..Gaussian::default() };
                    [vec![scaled(3e38), scaled(1e3), scaled(-3e38)], static_crowd(20)].concat()
                };
                StabilityScene::new(field(&rows(f32::MAX)), at(&T))
                    .meant(field(&rows(20.0)))
                    .refused("log_scales")
            },
        ),
        case(
            GROUP,
            "needles of anisotropy 1e8 along the axes",
            5.0,
            "determinants by a cross product, which does not cancel; a coder's rounding turns a quaternion by \
             1e-4 rad, which shows on 1000 units that point at the eye",
            || needles([[1.0, 0.0, 0.0, 0.0]; 4], 1e3, 1e-5),
        ),
        case(
            GROUP,
            "needles of anisotropy 1e8, turned",
            4.0,
            "quaternions in 47 bits turn an axis by 1e-4 rad: at most 0.02 px at the edge of this picture",
            || {
                let turns = [
                    [0.9, 0.1, -0.2, 0.3],
                    [0.3, 0.6, -0.1, 0.7],
                    [0.5, -0.2, 0.8, 0.1],
                    [0.7, 0.1, 0.0, -0.7],
                ];
                needles(turns.map(normalized), 3.0, 3e-8)
            },
        ),
        case(
            GROUP,
            "seen from the end and on edge: singular but for the blur",
            2.0,
            "0.3 px^2 of blur in both; the smaller eigenvalue from the cross product",
            || {
                let center = [[-0.9f32, 0.0, 0.0], [0.0; 3], [0.9, 0.0, 0.0], [0.0, 0.6, 0.0]];
                // Towards the eye, a disc through it, a point, a line.
                let sizes = [[1e-7, 1e-7, 2.0], [1e-7, 0.4, 0.4], [1e-8; 3], [0.5, 1e-8, 1e-8]];
                let row = |i: usize| Gaussian { center: center[i], ..Gaussian::default() }.sized(sizes[i]);
                StabilityScene::new(field(&[0, 1, 2, 3].map(row)), at(&T))
            },
        ),
        case(
            GROUP,
            "around the eye and behind it",
            2.0,
            "drawn if its centre is ahead; the Jacobian is taken within 1.3 times the field of view",
            || {
                let behind = [-0.5, -1e-3, -1e-5].map(|z| ahead([0.0, 0.0, z], [3.0; 3]));
                let around = [[0.02, 0.0, 0.05], [-3.0, 1.0, 0.4], [0.0, -40.0, 0.011], [200.0, 0.0, 9.0]]
                    .map(|p| ahead(p, [1.0, 2.0, 0.7]));
                let rows = [behind.to_vec(), around.to_vec(), static_crowd(20)].concat();
                StabilityScene::new(field(&rows), at(&T))
            },
        ),
        case(
            GROUP,
            "a plate from around the eye to 1e6 units away",
            2.0,
            "drawn after everything else, so behind it at any depth; culled as everything is",
            || {
                let around = [[0.02, 0.0, 0.05], [-3.0, 1.0, 0.4]].map(|p| ahead(p, [1.0, 2.0, 0.7]));
                let wall =
                    [10.0, 1e3, 1e6].map(|z: f32| ahead([0.1 * z, -0.1 * z, z], [0.4 * z, 0.3 * z, 1e-8]));
                StabilityScene::new(field(&crowd(40)), at(&T))
                    .before(field(&[around.to_vec(), wall.to_vec()].concat()))
            },
        ),
        case(
            GROUP,
            "at the ends of the fade near the eye",
            2.0,
            "nothing is drawn up to half of the near distance, and all from it on; positions are relative to the eye before \
             rotation",
            || {
                let row = |(i, z): (usize, f32)| ahead([0.002 * (i as f32 - 2.0), 0.001, z], [4e-4; 3]);
                let depths = [0.00499, 0.00501, 0.00999, 0.01001, 0.0105];
                let rows: Vec<Gaussian> = depths.into_iter().enumerate().map(row).collect();
                let field = field(&[rows, static_crowd(20)].concat());
                StabilityScene::new(Field { near: 0.01, ..field }, at(&T))
                    .untried("rounding moves it through the fade")
            },
        ),
        case(
            GROUP,
            "fading near the eye",
            2.0,
            "opacity grows evenly with the depth, from half of the near distance on",
            || in_units_of(1.0),
        ),
        case(GROUP, "fading near the eye, a thousandth as large", 2.0, "no length is absolute", || {
            in_units_of(1e-3)
        }),
        case(GROUP, "fading near the eye, a million times as large", 2.0, "no length is absolute", || {
            in_units_of(1e6)
        }),
        case(
            GROUP,
            "at the horizon, to 1e9 units away",
            2.0,
            "the Jacobian is taken within 1.3 times the field of view",
            || {
                let rows = [
                    ahead([0.0, 30.0, 1e3], [300.0, 1.0, 300.0]),
                    ahead([0.0, 1e4, 1e6], [4e5, 10.0, 4e5]),
                    ahead([2e8, -1e8, 9e8], [8e7; 3]),
                    ahead([50.0, 0.3, 1.0], [20.0, 0.1, 0.5]),
                    ahead([-3e5, -2.0, 4.0], [1e5, 1.0, 1.0]),
                ];
                StabilityScene::new(field(&[rows.to_vec(), static_crowd(20)].concat()), at(&T))
                    .untried("cells of the coder's grid are larger than the rest of the scene")
            },
        ),
        case(
            GROUP,
            "footprints of 1e8 to 1e13 pixels",
            2.0,
            "shrunk to 1e6 pixels towards the middle of the image, whose distance in standard deviations stays the same",
            || {
                let rows = [
                    ahead([0.3, 0.0, 0.0101], [1e6; 3]),
                    ahead([-2e4, 5e3, 0.011], [2e4; 3]),
                    ahead([1e8, -1e8, 0.02], [1e8; 3]),
                    ahead([3e5, 0.0, 0.0102], [1e5, 4e8, 1e-3]),
                ];
                let faint = rows.map(|row| Gaussian { opacity: 0.35, ..row });
                StabilityScene::new(field(&[faint.to_vec(), static_crowd(20)].concat()), at(&T))
                    .untried("cells of the coder's grid are larger than the rest of the scene")
            },
        ),
        case(
            GROUP,
            "1e6 units from the origin",
            2.0,
            "views in f64; centres stored from the median of the clip; rounded to 1/16 unit in the field itself",
            || from_the_origin(1e6),
        ),
        case(
            GROUP,
            "1e6 units from the origin, and a stray at 1e30",
            2.0,
            "the median does not follow strays",
            || {
                let mut scene = from_the_origin(1e6);
                let mut rows = moved(1e6);
                rows.push(Gaussian { center: [1e30, -1e30, 1e30], ..Gaussian::default() });
                scene.clip = super::case::exact(field(&rows));
                scene.refused("centers")
            },
        ),
        case(
            GROUP,
            "smaller than a pixel",
            2.5,
            "0.3 px^2 of blur, so that it never falls between pixels",
            || {
                let rows: Vec<Gaussian> =
                    crowd(800).into_iter().map(|row| row.sized([2e-4, 1e-3, 5e-5])).collect();
                StabilityScene::new(field(&rows), at(&[0.3, 0.6]))
            },
        ),
        case(
            GROUP,
            "subpixel needles with the mip filter, zooming in",
            2.0,
            "opacity by a quotient of determinants that do not cancel, never negative; it follows the scale from a \
             hundredth of a pixel to a pixel",
            || {
                let zoom =
                    |distance: f64| PosedView { camera: look([0.0, 0.0, -distance], [0.0; 3]), t: 0.5 };
                let rows: Vec<Gaussian> =
                    crowd(800).into_iter().map(|row| row.sized([0.1, 2e-3, 1e-5])).collect();
                let field = Field { filter: PixelFilter::Mip, ..field(&rows) };
                StabilityScene::new(field, [256.0, 64.0, 16.0, 4.0, 2.0].map(zoom).to_vec())
            },
        ),
        case(
            GROUP,
            "scales from 1e-8 to 1e6 of the scene with the mip filter",
            2.0,
            "opacity by a quotient of determinants that do not cancel; compensated to nothing, it is not drawn",
            || {
                let row = |k: i32| {
                    let center = [0.2 * (k + 1) as f32, 0.1 * (k % 3) as f32, 0.05 * k as f32];
                    Gaussian { center, opacity: 0.3, ..Gaussian::default() }.sized([10f32.powi(k); 3])
                };
                let rows: Vec<Gaussian> = (-8..=6).map(row).collect();
                let field = field(&[rows, static_crowd(20)].concat());
                StabilityScene::new(Field { filter: PixelFilter::Mip, ..field }, at(&T))
            },
        ),
        case(
            GROUP,
            "larger than the screen",
            2.0,
            "no side of a quad reaches beyond the farthest corner of the image",
            || {
                let large = |i: usize| Gaussian {
                    center: [i as f32 - 2.0, 0.5 * i as f32, 3.0 + i as f32],
                    opacity: [1.0, 0.2, 0.6][i % 3],
                    color: [0.1 + 0.2 * i as f32, 0.9 - 0.2 * i as f32, 0.5],
                    ..Gaussian::default()
                };
                let rows: Vec<Gaussian> = (0..5).map(|i| large(i).sized([100.0, 30.0, 8.0])).collect();
                StabilityScene::new(field(&[rows, static_crowd(20)].concat()), at(&T))
            },
        ),
        case(GROUP, "quaternions almost of length 1", 1.5, "normalised when packed", || {
            StabilityScene::new(turned_by([1.0004, 0.9997]), at(&T))
        }),
        case(GROUP, "quaternions of any length", 1.5, "normalised when packed", || {
            StabilityScene::new(turned_by([3.0, 0.2]), at(&T)).refused("column rotations")
        }),
        case(GROUP, "quaternions that are zero or not finite", 1.5, "packed as no rotation", || {
            let with = |rotations: [[f32; 4]; 3]| {
                let row = |i: usize| Gaussian {
                    center: [i as f32 - 1.0, 0.0, 0.0],
                    rotation: rotations[i],
                    ..Gaussian::default()
                };
                field(&[0, 1, 2].map(|i| row(i).sized([0.3, 0.1, 0.1])))
            };
            let broken = [[0.0; 4], [f32::NAN; 4], [f32::INFINITY, 0.0, -1.0, 0.0]];
            let meant = with([[1.0, 0.0, 0.0, 0.0]; 3]);
            StabilityScene::new(with(broken), at(&T)).meant(meant).refused("column rotations")
        }),
        case(
            GROUP,
            "colours of 1e30",
            1.5,
            "limited to the largest f16 when packed: the brightest colour that an image can hold",
            || {
                let mut field = field(&static_crowd(20));
                field.sh[3] = [1e30, 0.0, -1e30];
                field.sh[4] = [1e30; 3];
                StabilityScene::new(field, at(&T)).refused("column sh")
            },
        ),
    ]
}

/// The crowd in units of `unit`, most of it nearer to the eye than it would have to be to be drawn whole.
fn in_units_of(unit: f32) -> StabilityScene {
    let mut rows = static_crowd(200);
    for row in &mut rows {
        row.center = row.center.map(|x| unit * x);
        row.log_scales = row.log_scales.map(|scale| scale + unit.ln());
    }
    let eyes = [[0.0, 0.0, -DISTANCE], [0.2, 0.1, -2.6]];
    let posed_views =
        eyes.map(|eye| PosedView { camera: look(eye.map(|x| f64::from(unit) * x), [0.0; 3]), t: 0.5 });
    StabilityScene::new(Field { near: 1.2 * DISTANCE as f32 * unit, ..field(&rows) }, posed_views.to_vec())
}

/// A Gaussian that the usual camera sees at `p`, in its own axes.
fn ahead(p: [f32; 3], scales: [f32; 3]) -> Gaussian {
    let center = [p[0], p[1], (f64::from(p[2]) - DISTANCE) as f32];
    Gaussian { center, opacity: 0.5, ..Gaussian::default() }.sized(scales)
}

/// Needles along x, y and z, and a disc, turned by `rotations`.
fn needles(rotations: [[f32; 4]; 4], length: f32, width: f32) -> StabilityScene {
    let sizes =
        [[length, width, width], [width, length, width], [width, width, length], [length, length, width]];
    let row = |i: usize| Gaussian {
        center: [0.1 * i as f32 - 0.15, 0.05 * i as f32, 0.3 * i as f32 - 0.4],
        rotation: rotations[i],
        opacity: 0.6,
        ..Gaussian::default()
    };
    StabilityScene::new(field(&[0, 1, 2, 3].map(|i| row(i).sized(sizes[i]))), at(&T))
}

/// The crowd, moved by `distance` along every axis.
fn moved(distance: f32) -> Vec<Gaussian> {
    let mut rows = crowd(60);
    rows.iter_mut().for_each(|row| row.center = row.center.map(|x| x + distance));
    rows
}

fn from_the_origin(distance: f32) -> StabilityScene {
    let d = f64::from(distance);
    let posed_views = [[0.1, 0.0, -4.0], [2.3, -1.0, -2.9]]
        .map(|eye: [f64; 3]| PosedView { camera: look(eye.map(|x| x + d), [d; 3]), t: 0.4 });
    StabilityScene::new(field(&moved(distance)), posed_views.to_vec())
}

/// Ordinary Gaussians whose quaternions have these two lengths in turn.
fn turned_by(lengths: [f32; 2]) -> Field {
    let mut rows = static_crowd(40);
    for (i, row) in rows.iter_mut().enumerate() {
        row.rotation = row.rotation.map(|x| x * lengths[i % 2]);
    }
    field(&rows)
}

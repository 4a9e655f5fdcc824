//! Extreme numbers of Gaussians: none, one, two million; all at one instant, all at one depth, alpha at its limits.

use client::gpu::SortOrder;
use codec::{ALPHA_MIN, Camera, Field};

use super::gaussians::{Gaussian, crowd, field, static_crowd};
use refine::reference::PosedView;

use super::case::{DeviationKind, StabilityCase, StabilityScene, at, case, look};

const GROUP: &str = "extreme amounts";

/// Turn of the head between two frames, in radians: far less than a pixel.
const TURN: f64 = 2e-5;

// Long: a table of cases.
pub(super) fn cases() -> Vec<StabilityCase> {
    let sorted = "a stable radix sort of 32-bit depths, 11 bits a pass";
    let mut cases = vec![
        case(GROUP, "none", 0.1, "no binding is empty; nothing is drawn", || StabilityScene {
            blank: true,
            ..StabilityScene::new(Field::default(), at(&[0.0, 0.5])).refused("no Gaussians")
        }),
        case(GROUP, "one", 1.5, sorted, || StabilityScene::new(field(&[Gaussian::default()]), at(&[0.5]))),
    ];
    for count in [65_535, 65_536, 65_537] {
        let scene = move || StabilityScene::new(many(count), at(&[0.5]));
        cases.push(case(GROUP, format!("{count}, all alive at one instant"), 4.0, sorted, scene));
    }
    cases.push(StabilityCase {
        slow: true,
        ..case(GROUP, "2,000,000, all alive at one instant", 6.0, sorted, || {
            let camera = Camera::look_at([0.0, 0.0, -4.0], [0.0; 3], [0.0, -1.0, 0.0], 0.8, 384, 288);
            StabilityScene::new(many(2_000_000), vec![PosedView { camera, t: 0.5 }])
                .untried("encoding them takes longer than all other cases together")
        })
    });
    cases.extend([
        case(
            GROUP,
            "all at one depth",
            2.0,
            "among equal depths the first row counts as the nearest, as in the reference",
            || StabilityScene::new(one_depth(), at(&[0.5])),
        ),
        StabilityCase {
            measure: DeviationKind::Change,
            ..case(
                GROUP,
                "all at one place, a turning head",
                3.0,
                "equal depths stay equal, and rows of equal depth keep their order",
                || {
                    let one_place = |row| Gaussian { center: [0.3, -0.2, 0.1], ..row };
                    let rows: Vec<Gaussian> = static_crowd(200).into_iter().map(one_place).collect();
                    StabilityScene::new(field(&rows), turning_head())
                },
            )
        },
        StabilityCase {
            measure: DeviationKind::Change,
            ..case(
                GROUP,
                "all at one distance, a turning head",
                3.0,
                "sorted by distance from the eye, which does not depend on the direction of view",
                || StabilityScene {
                    sort: SortOrder::Radial,
                    ..StabilityScene::new(one_distance(), turning_head())
                },
            )
        },
        case(GROUP, "alpha 0", 0.1, "below 1/255, so not drawn", || StabilityScene {
            blank: true,
            ..StabilityScene::new(with_alpha(0.0), at(&[0.5]))
        }),
        case(GROUP, "alpha 1.1/255", 0.1, "drawn where alpha reaches 1/255", || faint(1.1)),
        case(GROUP, "alpha 0.9/255", 0.1, "below 1/255, so not drawn", || faint(0.9)),
        case(GROUP, "alpha 1", 2.0, "limited to 0.999", || StabilityScene::new(with_alpha(1.0), at(&[0.5]))),
    ]);
    cases
}

/// `count` small Gaussians, all alive during the same hundredth of the clip.
fn many(count: usize) -> Field {
    let mut rows = crowd(count);
    for (i, row) in rows.iter_mut().enumerate() {
        let (tau, s) = (0.5, 0.01);
        *row = Gaussian { opacity: 0.1 + 0.3 * (i % 7) as f32 / 6.0, tau, s, ..*row }
            .sized([0.004, 0.002, 0.006]);
    }
    field(&rows)
}

/// The crowd, with all centres in a plane across the view.
fn one_depth() -> Field {
    let flat = |row: Gaussian| Gaussian { center: [row.center[0], row.center[1], 0.0], ..row };
    field(&static_crowd(300).into_iter().map(flat).collect::<Vec<_>>())
}

/// The crowd, with all centres on a sphere around the eye of [`turning_head`], rounded to f32.
fn one_distance() -> Field {
    let on_sphere = |row: Gaussian| {
        let [x, y, _] = row.center.map(f64::from);
        let d = [x, y, 4.0];
        let norm = d.iter().map(|x| x * x).sum::<f64>().sqrt();
        let p = d.map(|x| 4.0 * x / norm);
        Gaussian { center: [p[0] as f32, p[1] as f32, (p[2] - 4.0) as f32], ..row }
    };
    field(&static_crowd(300).into_iter().map(on_sphere).collect::<Vec<_>>())
}

/// Views of the default camera, turned a little further in each frame.
fn turning_head() -> Vec<PosedView> {
    let posed_view = |frame: i32| {
        let angle = TURN * f64::from(frame);
        let camera = look([0.0, 0.0, -4.0], [4.0 * angle.sin(), 1.3 * angle.sin(), 4.0 * angle.cos() - 4.0]);
        PosedView { camera, t: 0.5 }
    };
    (0..60).map(posed_view).collect()
}

/// A Gaussian over the whole image with an opacity of so many times [`ALPHA_MIN`]. Its alpha falls by 4 % to the corners:
/// it is on one side of the limit in all pixels.
fn faint(opacity: f32) -> StabilityScene {
    let row = Gaussian { opacity: opacity * ALPHA_MIN as f32, ..Gaussian::default() }.sized([10.0; 3]);
    StabilityScene { blank: true, ..StabilityScene::new(field(&[row]), at(&[0.5])) }
        .untried("a package rounds its opacity, perhaps across the limit")
}

/// Six separate Gaussians of this opacity.
fn with_alpha(opacity: f32) -> Field {
    let row = |i: usize| Gaussian {
        center: [0.8 * (i % 3) as f32 - 0.8, 0.8 * (i / 3) as f32 - 0.4, 0.0],
        opacity,
        ..Gaussian::default()
    };
    field(&(0..6).map(|i| row(i).sized([0.1; 3])).collect::<Vec<_>>())
}

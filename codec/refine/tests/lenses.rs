//! Compares lenses with OpenCV's in `opencv_lenses.txt`, written by `opencv_lenses.py`, and inverts them.

use codec::Camera;
use refine::capture::Lens;

const TABLE: &str = include_str!("opencv_lenses.txt");

/// Maximum error of a round trip in pixels.
const ROUND_TRIP_PX: f64 = 0.2;

/// A lens of the table.
struct Reference {
    /// Its line.
    name: &'static str,
    lens: Lens,
    camera: Camera,
    /// Radius at which it ends.
    end: f64,
    /// Points without the lens, normalised, and with it, in pixels, that OpenCV distorts.
    projected: Vec<[f64; 4]>,
    /// The same that OpenCV undistorts.
    undistorted: Vec<[f64; 4]>,
}

fn numbers(text: &str) -> Vec<f64> {
    text.split_whitespace().map(|word| word.parse().unwrap()).collect()
}

fn table() -> Vec<Reference> {
    let mut table: Vec<Reference> = Vec::new();
    let mut is_undistorted = false;
    for line in TABLE.lines().filter(|line| !line.starts_with('#')) {
        if let [head, coefficients, end] = line.split('|').collect::<Vec<_>>()[..] {
            let (model, numbers_of_camera) = head.split_once(' ').unwrap();
            let [width, height, fx, fy, cx, cy] = numbers(numbers_of_camera)[..] else { panic!("{line}") };
            let look = Camera::look_at([0.0; 3], [0.0, 0.0, 1.0], [0.0, 1.0, 0.0], 1.0, 1, 1);
            let k = [[fx, 0.0, cx], [0.0, fy, cy], [0.0, 0.0, 1.0]];
            let create = if model == "fisheye" { Lens::fisheye } else { Lens::rational };
            table.push(Reference {
                name: line,
                lens: create(&numbers(coefficients)).unwrap(),
                camera: Camera { width: width as u32, height: height as u32, k, ..look },
                end: end.trim().parse().unwrap(),
                projected: Vec::new(),
                undistorted: Vec::new(),
            });
        } else if line == "project" || line == "undistort" {
            is_undistorted = line == "undistort";
        } else {
            let last = table.last_mut().unwrap();
            let points = if is_undistorted { &mut last.undistorted } else { &mut last.projected };
            points.push(numbers(line).try_into().unwrap());
        }
    }
    table
}

impl Reference {
    /// Pixels of a normalised point.
    fn pixels(&self, point: [f64; 2]) -> [f64; 2] {
        [0, 1].map(|axis| point[axis] * self.camera.k[axis][axis] + self.camera.k[axis][2])
    }

    /// Normalised point of pixels.
    fn normalised(&self, pixels: [f64; 2]) -> [f64; 2] {
        [0, 1].map(|axis| (pixels[axis] - self.camera.k[axis][2]) / self.camera.k[axis][axis])
    }
}

fn distance(a: [f64; 2], b: [f64; 2]) -> f64 {
    (a[0] - b[0]).hypot(a[1] - b[1])
}

/// Inverts a lens by Newton's method, from the point in the same direction whose distorted radius is right.
fn undistorted(lens: &Lens, target: [f64; 2]) -> Option<[f64; 2]> {
    let wanted = target[0].hypot(target[1]);
    let [mut low, mut high] = [0.0, 1e3];
    for _ in 0..100 {
        let half_way: f64 = 0.5 * (low + high);
        let bent = lens.distort(target.map(|x| x / wanted * half_way));
        if bent.is_some_and(|[x, y]| x.hypot(y) < wanted) { low = half_way } else { high = half_way }
    }
    let mut at = target.map(|x| x / wanted.max(1e-300) * low);
    for _ in 0..100 {
        let bent = lens.distort(at)?;
        let residual = [target[0] - bent[0], target[1] - bent[1]];
        let step = 1e-7 * at[0].hypot(at[1]).max(1e-3);
        let slope = |axis: usize| {
            // Inwards, as there is nothing beyond the end of the lens.
            let step = if at[axis] > 0.0 { -step } else { step };
            let mut near = at;
            near[axis] += step;
            lens.distort(near).map(|near| [(near[0] - bent[0]) / step, (near[1] - bent[1]) / step])
        };
        let [[a, c], [b, d]] = [slope(0)?, slope(1)?];
        let determinant = a * d - b * c;
        let newton = [
            (d * residual[0] - b * residual[1]) / determinant,
            (a * residual[1] - c * residual[0]) / determinant,
        ];
        let mut part = 1.0;
        let error = |at: [f64; 2]| lens.distort(at).map_or(f64::INFINITY, |bent| distance(bent, target));
        let next = |part: f64| [at[0] + part * newton[0], at[1] + part * newton[1]];
        while error(next(part)) > error(at) && part > 1e-6 {
            part *= 0.5;
        }
        if error(next(part)) >= error(at) {
            break;
        }
        at = next(part);
    }
    Some(at)
}

#[test]
fn points_are_distorted_as_by_opencv() {
    let table = table();
    assert!(table.len() >= 14 && TABLE.starts_with("# OpenCV "));
    for reference in &table {
        assert_eq!(reference.projected.len(), 40, "{}", reference.name);
        for &[x, y, u, v] in &reference.projected {
            let bent =
                reference.lens.distort([x, y]).unwrap_or_else(|| panic!("{}: {x} {y}", reference.name));
            let error = distance(reference.pixels(bent), [u, v]);
            // Near a pole, coordinates have millions of pixels.
            assert!(error < 1e-9 * u.hypot(v).max(1.0), "{}: {x} {y}: {error} px", reference.name);
        }
    }
}

#[test]
fn points_that_opencv_undistorts_are_distorted_back() {
    let mut count = 0;
    for reference in table() {
        for &[x, y, u, v] in &reference.undistorted {
            let bent =
                reference.lens.distort([x, y]).unwrap_or_else(|| panic!("{}: {x} {y}", reference.name));
            let error = distance(reference.pixels(bent), [u, v]);
            // OpenCV's own error is up to 1e-6 px.
            assert!(error < 2e-6, "{}: {u} {v}: {error} px", reference.name);
            count += 1;
        }
    }
    assert!(count > 300, "{count}");
}

#[test]
fn lenses_end_where_numpy_finds_the_root() {
    for Reference { name, lens, end, .. } in table() {
        let at = |r: f64| lens.distort([0.6 * r, -0.8 * r]);
        if end.is_finite() {
            assert!(at(end * (1.0 - 1e-9)).is_some() && at(end * (1.0 + 1e-9)).is_none(), "{name}");
        } else {
            assert!(at(99.0).is_some(), "{name}");
        }
    }
}

#[test]
fn each_pixel_of_an_undistorted_image_comes_back() {
    for reference in table() {
        let sides = [reference.camera.width, reference.camera.height];
        let size = sides.map(|side| side / 8);
        let scale = [0, 1].map(|axis| f64::from(sides[axis]) / f64::from(size[axis]));
        let (mut usable, mut worst): (usize, f64) = (0, 0.0);
        for (i, source) in reference.lens.sources(&reference.camera, size).enumerate() {
            let Some(source) = source.map(|at| [at[0] * scale[0], at[1] * scale[1]]) else { continue };
            if (0..2).any(|axis| !(0.0..f64::from(sides[axis])).contains(&source[axis])) {
                continue;
            }
            let [column, row] = [i as u32 % size[0], i as u32 / size[0]].map(|x| f64::from(x) + 0.5);
            let pixel = [column * scale[0], row * scale[1]];
            let back = undistorted(&reference.lens, reference.normalised(source));
            let back = back.unwrap_or_else(|| panic!("{}: {pixel:?}", reference.name));
            worst = worst.max(distance(reference.pixels(back), pixel));
            usable += 1;
        }
        println!("{}: {usable} of {} pixels, {worst:.1e} px", reference.name, size[0] * size[1]);
        assert!(usable > 5 && worst < ROUND_TRIP_PX, "{}: {usable} pixels, {worst} px", reference.name);
    }
}

//! [`recolor`]: the colours of a pruned field, fitted to pictures of the whole.
//!
//! With geometry and opacity fixed, a picture is linear in the colours (but for their cut at 0,
//! which is taken as it is at the start), so the best change of colours is a linear least-squares
//! problem. It is solved by preconditioned conjugate gradients, first for the constant terms, then,
//! where there is more, for all spherical harmonics. Nothing about the whole field is needed but
//! its pictures.

use codec::{Field, sh_coefficients};

use super::Pictures;
use crate::image::Image;
use crate::reference::{Colors, Order, RenderScene, render};

/// Steps of conjugate gradients per stage.
const STEPS: usize = 12;

/// Times that [`recolor`] walks over each picture, for each of its stages: two to set up, and one per
/// step.
pub const PASSES: usize = 2 + STEPS;

/// Weight that holds colours where they were, as a part of the mean of the diagonal: what is
/// hardly seen should not take a colour that only suits the few pixels that show it.
const HOLD: f64 = 1e-2;

/// `field` with the colours that reproduce `pictures` best, drawn over `plate` if there is one.
/// `on_pass` is called [`PASSES`] times per picture, and as often again if the degree of the
/// spherical harmonics is above 0. The same on any number of threads.
pub fn recolor(
    field: &Field,
    plate: Option<&Field>,
    pictures: &Pictures,
    mut on_pass: impl FnMut(),
) -> Field {
    let mut field = field.clone();
    stage(&mut field, plate, pictures, 1, &mut on_pass);
    if field.sh_degree > 0 {
        let all = sh_coefficients(field.sh_degree);
        stage(&mut field, plate, pictures, all, &mut on_pass);
    }
    field
}

/// Fits the first `free` coefficients of every Gaussian.
fn stage(
    field: &mut Field,
    plate: Option<&Field>,
    pictures: &Pictures,
    free: usize,
    on_pass: &mut impl FnMut(),
) {
    let coefficients = sh_coefficients(field.sh_degree);
    let free = |index: usize| index % coefficients < free;
    let len = field.sh.len();
    let mut residual = vec![[0.0; 3]; len];
    let mut diagonal = vec![[0.0; 3]; len];
    for (shot, target) in &pictures.taken {
        let colors = Colors::new(field, &shot.camera, shot.t);
        let scene = RenderScene::from(&*field);
        let scene = plate.map_or(scene.clone(), |plate| scene.with_plate(plate));
        let missing = difference(target, &render(&scene, &shot.camera, shot.t, Order::Depth));
        colors.add_transposed(&missing, &mut residual);
        on_pass();
        colors.add_diagonal(&mut diagonal);
        on_pass();
    }
    let seen: Vec<f64> = diagonal.iter().flatten().copied().filter(|&d| d > 0.0).collect();
    if seen.is_empty() {
        return;
    }
    let hold = HOLD * seen.iter().sum::<f64>() / seen.len() as f64;
    for (index, residual) in residual.iter_mut().enumerate() {
        if !free(index) {
            *residual = [0.0; 3];
        }
    }
    let precondition = |r: &[[f64; 3]]| -> Vec<[f64; 3]> {
        r.iter().zip(&diagonal).map(|(r, d)| [0, 1, 2].map(|c| r[c] / (d[c] + hold))).collect()
    };

    let mut change = vec![[0.0; 3]; len];
    let mut scaled = precondition(&residual);
    let mut direction = scaled.clone();
    let mut size = dot(&residual, &scaled);
    for _ in 0..STEPS {
        let mut image = vec![[0.0; 3]; len];
        for (shot, _) in &pictures.taken {
            Colors::new(field, &shot.camera, shot.t).add_normal(&direction, &mut image);
            on_pass();
        }
        for (index, (image, direction)) in image.iter_mut().zip(&direction).enumerate() {
            let held = [0, 1, 2].map(|c| image[c] + hold * direction[c]);
            *image = if free(index) { held } else { [0.0; 3] };
        }
        let curvature = dot(&direction, &image);
        if curvature > 0.0 {
            let step = size / curvature;
            add(&mut change, step, &direction);
            add(&mut residual, -step, &image);
            scaled = precondition(&residual);
            let next = dot(&residual, &scaled);
            let previous = std::mem::replace(&mut direction, scaled);
            add(&mut direction, next / size, &previous);
            size = next;
        }
    }
    for (coefficient, change) in field.sh.iter_mut().zip(&change) {
        *coefficient = [0, 1, 2].map(|c| (f64::from(coefficient[c]) + change[c]) as f32);
    }
}

/// `a - b`.
fn difference(a: &Image, b: &Image) -> Image {
    let pixels = a.pixels.iter().zip(&b.pixels).map(|(a, b)| [0, 1, 2, 3].map(|c| a[c] - b[c]));
    Image { width: a.width, height: a.height, pixels: pixels.collect() }
}

/// Adds `factor` times `b` to `a`.
fn add(a: &mut [[f64; 3]], factor: f64, b: &[[f64; 3]]) {
    for (a, b) in a.iter_mut().zip(b) {
        (0..3).for_each(|c| a[c] += factor * b[c]);
    }
}

fn dot(a: &[[f64; 3]], b: &[[f64; 3]]) -> f64 {
    a.iter().zip(b).map(|(a, b)| a[0] * b[0] + a[1] * b[1] + a[2] * b[2]).sum()
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::prune::scenes::{balls, cloud};
    use crate::prune::{PosedView, Ranking, by_importance, dome, posed_views};

    fn pictures_of(field: &Field, turn: f64, instants: &[f64]) -> Pictures {
        let cameras = dome(field, &[0.5], [0.0, 1.0, 0.0], turn, (64, 48));
        Pictures::take(&field.into(), posed_views(&cameras, instants), || ())
    }

    #[test]
    fn spoiled_colors_come_back() {
        for degree in [0, 1u8] {
            let mut field = cloud(3, 50);
            if degree == 0 {
                field.sh = (0..50).map(|row| field.sh_of(row)[0]).collect();
                field.sh_degree = 0;
            }
            let mut spoiled = field.clone();
            for (i, c) in spoiled.sh.iter_mut().enumerate() {
                c[i % 3] += if i % 2 == 0 { 0.3 } else { 0.15 };
            }
            let pictures = pictures_of(&field, 0.0, &[0.2, 0.5, 0.8]);
            let mut passes = 0;
            let recolored = recolor(&spoiled, None, &pictures, || passes += 1);
            assert_eq!(passes, 24 * PASSES * (1 + usize::from(degree > 0)));
            let [before, after] = [&spoiled, &recolored].map(|field| pictures.psnr(&field.into(), || ()));
            assert!(after > before + 10.0, "degree {degree}: {before} dB before, {after} dB after");
        }
    }

    #[test]
    fn those_that_stay_make_up_for_those_that_leave_also_where_nobody_looked() {
        let field = cloud(4, 400);
        let kept: Vec<usize> = by_importance(&Ranking::Mass.scores(&field, &[]))[..200].to_vec();
        let part = field.select(&kept);
        let recolored = recolor(&part, None, &pictures_of(&field, 0.0, &[0.1, 0.3, 0.5, 0.7, 0.9]), || ());
        let unseen = pictures_of(&field, 0.5, &[0.2, 0.4, 0.6, 0.8]);
        let [before, after] = [&part, &recolored].map(|field| unseen.psnr(&field.into(), || ()));
        assert!(after > before + 0.5, "{before} dB before, {after} dB after");
        assert_eq!(recolored.centers, part.centers);
    }

    #[test]
    fn what_is_right_or_not_seen_does_not_change() {
        let mut field = balls(&[[0.0; 3], [0.3, 0.0, 0.0], [0.0, 0.0, 90.0]], 0.2, 0.8);
        field.sh[1] = [0.5, -0.2, 0.1];
        let camera = codec::Camera::look_at([0.0, 0.0, -3.0], [0.0; 3], [0.0, 1.0, 0.0], 0.8, 32, 32);
        let shot = PosedView { camera, t: 0.0 };
        let pictures = Pictures::take(&(&field.select(&[0, 1])).into(), vec![shot], || ());
        let mut hidden = field.clone();
        hidden.opacities[2] = 0.0;
        assert_eq!(recolor(&hidden, None, &pictures, || ()), hidden);
        assert_eq!(recolor(&field, None, &Pictures { taken: Vec::new() }, || ()), field);
    }
}

//! [`recolor`]: fits the colours of a pruned field to pictures of the whole field.
//!
//! With geometry and opacity fixed, a picture is linear in the colours, apart from the clamp at 0, whose
//! active set is taken from the start. The best colours are therefore a linear least-squares problem,
//! solved by preconditioned conjugate gradients: first for the constant terms, then for all spherical
//! harmonics. Only the pictures of the whole field are needed, not the field.

use codec::{Field, sh_coefficients};

use super::Pictures;
use crate::image::Image;
use crate::reference::{Colors, Order, RenderScene, render};

/// Conjugate-gradient steps per stage.
const STEPS: usize = 12;

/// Passes of [`recolor`] over each picture in each of its stages: two to set up, and one per step.
pub const PASSES: usize = 2 + STEPS;

/// Damping towards the present colours, as a fraction of the mean of the diagonal: it prevents barely
/// visible Gaussians from fitting the few pixels that show them.
const DAMPING: f64 = 1e-2;

/// Returns `field` with the colours that best reproduce `pictures` when drawn over `plate`. `on_pass` is
/// called [`PASSES`] times per picture, twice as often if the degree of the spherical harmonics is above
/// 0. The result does not depend on the number of threads.
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

/// Fits the first `free` coefficients of each Gaussian.
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
    let (mut residual, diagonal) = normal_equations(field, plate, pictures, on_pass);
    let seen: Vec<f64> = diagonal.iter().flatten().copied().filter(|&d| d > 0.0).collect();
    if seen.is_empty() {
        return;
    }
    let damping = DAMPING * seen.iter().sum::<f64>() / seen.len() as f64;
    for (index, residual) in residual.iter_mut().enumerate() {
        if !free(index) {
            *residual = [0.0; 3];
        }
    }
    let precondition = |r: &[[f64; 3]]| -> Vec<[f64; 3]> {
        r.iter().zip(&diagonal).map(|(r, d)| [0, 1, 2].map(|c| r[c] / (d[c] + damping))).collect()
    };

    let mut change = vec![[0.0; 3]; len];
    let mut scaled = precondition(&residual);
    let mut direction = scaled.clone();
    let mut size = dot(&residual, &scaled);
    for _ in 0..STEPS {
        let mut image = vec![[0.0; 3]; len];
        for (view, _) in &pictures.taken {
            Colors::new(field, &view.camera, view.t).add_normal(&direction, &mut image);
            on_pass();
        }
        for (index, (image, direction)) in image.iter_mut().zip(&direction).enumerate() {
            let damped = [0, 1, 2].map(|c| image[c] + damping * direction[c]);
            *image = if free(index) { damped } else { [0.0; 3] };
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

/// The right-hand side `A^T (target - picture)` of the normal equations, and the diagonal of `A^T A`.
fn normal_equations(
    field: &Field,
    plate: Option<&Field>,
    pictures: &Pictures,
    on_pass: &mut impl FnMut(),
) -> (Vec<[f64; 3]>, Vec<[f64; 3]>) {
    let mut residual = vec![[0.0; 3]; field.sh.len()];
    let mut diagonal = residual.clone();
    for (view, target) in &pictures.taken {
        let colors = Colors::new(field, &view.camera, view.t);
        let scene = RenderScene::from(field);
        let scene = plate.map_or(scene.clone(), |plate| scene.with_plate(plate));
        let missing = difference(target, &render(&scene, &view.camera, view.t, Order::Depth));
        colors.add_transposed(&missing, &mut residual);
        on_pass();
        colors.add_diagonal(&mut diagonal);
        on_pass();
    }
    (residual, diagonal)
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
    use crate::prune::scenes::{around, balls, cloud};
    use crate::prune::{Ranking, by_importance, posed_views};
    use crate::reference::PosedView;

    fn pictures_of(field: &Field, turn: f64, instants: &[f64]) -> Pictures {
        let cameras = around(field, turn, (64, 48));
        Pictures::take(&field.into(), posed_views(&cameras, instants), || ())
    }

    #[test]
    fn perturbed_colors_are_recovered() {
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
            let count = pictures.taken.len();
            let mut passes = 0;
            let recolored = recolor(&spoiled, None, &pictures, || passes += 1);
            assert_eq!(passes, count * PASSES * (1 + usize::from(degree > 0)));
            let [before, after] = [&spoiled, &recolored].map(|field| pictures.psnr(&field.into(), || ()));
            assert!(after > before + 10.0, "degree {degree}: {before} dB before, {after} dB after");
        }
    }

    #[test]
    fn recoloring_a_pruned_field_improves_unseen_views() {
        let field = cloud(4, 400);
        let retained: Vec<usize> = by_importance(&Ranking::Mass.scores(&field, &[]))[..200].to_vec();
        let part = field.select(&retained);
        let recolored = recolor(&part, None, &pictures_of(&field, 0.0, &[0.1, 0.3, 0.5, 0.7, 0.9]), || ());
        let unseen = pictures_of(&field, 0.5, &[0.2, 0.4, 0.6, 0.8]);
        let [before, after] = [&part, &recolored].map(|field| unseen.psnr(&field.into(), || ()));
        assert!(after > before + 0.5, "{before} dB before, {after} dB after");
        assert_eq!(recolored.centers, part.centers);
    }

    #[test]
    fn correct_and_invisible_colors_do_not_change() {
        let mut field = balls(&[[0.0; 3], [0.3, 0.0, 0.0], [0.0, 0.0, 90.0]], 0.2, 0.8);
        field.sh[1] = [0.5, -0.2, 0.1];
        let camera = codec::Camera::look_at([0.0, 0.0, -3.0], [0.0; 3], [0.0, 1.0, 0.0], 0.8, 32, 32);
        let view = PosedView { camera, t: 0.0 };
        let pictures = Pictures::take(&(&field.select(&[0, 1])).into(), vec![view], || ());
        let mut hidden = field.clone();
        hidden.opacities[2] = 0.0;
        assert_eq!(recolor(&hidden, None, &pictures, || ()), hidden);
        assert_eq!(recolor(&field, None, &Pictures::take(&(&field).into(), Vec::new(), || ()), || ()), field);
    }
}

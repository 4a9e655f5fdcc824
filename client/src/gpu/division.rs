//! [`Division`]: the two views of an eye in a foveated frame.
//!
//! The wide view shows everything with fewer pixels; the inset shows the middle with the pixels of the composed image.
//! Both have the same number of pixels: with an inset of 0.45 of the image's sides, 0.4 of the pixels are left.

use glam::{UVec2, Vec2};
use shaders::filter_variance;

use crate::view::View;

/// Images are multiples of this many pixels wide and high, the block size of GPUs.
const BLOCK: u32 = 8;

/// Width of the edge in which the inset fades into the wide view, as a fraction of its sides.
const FEATHER: f32 = 0.05;

/// The views of an eye.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(super) struct Division {
    /// All of the image, in fewer pixels.
    pub(super) wide: View,
    /// Its middle: the pixels of the composed image around the view axis.
    pub(super) inset: View,
    /// Upper left pixel of the inset in the composed image.
    pub(super) offset: UVec2,
    /// Pixels of the wide view per pixel of the composed image.
    pub(super) wide_from_full: Vec2,
}

impl Division {
    /// Divides `view`; `side` is the inset's side as a fraction of the image's sides, above 0 and below 1.
    pub(super) fn new(view: &View, side: f32) -> Division {
        let size = part_size(view.size, side);
        let wide_from_full = size.as_vec2() / view.size.as_vec2();
        let wide = View {
            focal: view.focal * wide_from_full,
            principal: view.principal * wide_from_full,
            size,
            ..*view
        };
        // The viewer looks along the axis, which is not the middle of an eye's image.
        let corner = (view.principal - 0.5 * size.as_vec2()).round().max(Vec2::ZERO);
        let offset = corner.as_uvec2().min(view.size - size);
        let inset = View { principal: view.principal - offset.as_vec2(), size, ..*view };
        Division { wide, inset, offset, wide_from_full }
    }

    /// Variance of the blur of 0.3 px^2 in the wide view's pixels, so that both views show the same Gaussians.
    pub(super) fn wide_blur(&self) -> f32 {
        filter_variance(false) * self.wide_from_full.element_product()
    }

    /// How the stage `foveate` composes the two images.
    pub(super) fn uniform(&self) -> shaders::layout::Foveation {
        let size = self.inset.size.as_vec2();
        shaders::layout::Foveation {
            offset: self.offset.as_vec2().to_array(),
            size: size.to_array(),
            wide_from_full: self.wide_from_full.to_array(),
            feather: FEATHER * size.min_element(),
            ..Default::default()
        }
    }
}

/// Size of the inset and of the wide view in images of `full` pixels.
pub(super) fn part_size(full: UVec2, side: f32) -> UVec2 {
    let blocks = (full.as_vec2() * side / BLOCK as f32).round().as_uvec2();
    (blocks * BLOCK).clamp(full.min(UVec2::splat(BLOCK)), full)
}

#[cfg(test)]
mod tests {
    use glam::{DMat4, DVec3, dvec3, vec2};

    use super::*;

    /// The left eye of a headset.
    fn eye() -> View {
        View::new(DMat4::IDENTITY, vec2(757.0, 756.0), vec2(1043.7, 680.4), UVec2::new(1680, 1760))
    }

    fn project(view: &View, point: DVec3) -> Vec2 {
        let p = point.as_vec3();
        view.focal * p.truncate() / p.z + view.principal
    }

    #[test]
    fn both_views_show_what_the_eye_sees() {
        let eye = eye();
        for side in [0.3, 0.45, 0.6] {
            let division = Division::new(&eye, side);
            for point in [dvec3(0.1, -0.2, 1.0), dvec3(-1.2, 0.8, 1.0), dvec3(0.0, 0.0, 3.0)] {
                let full = project(&eye, point);
                let wide = project(&division.wide, point) / division.wide_from_full;
                assert!(wide.distance(full) < 1e-2, "{wide} {full}");
                let inset = project(&division.inset, point) + division.offset.as_vec2();
                assert!(inset.distance(full) < 1e-3, "{inset} {full}");
            }
        }
    }

    #[test]
    fn the_inset_is_around_the_axis_on_whole_pixels() {
        let division = Division::new(&eye(), 0.45);
        assert_eq!(division.inset.size, UVec2::new(760, 792));
        assert_eq!((division.wide.size, division.offset), (division.inset.size, UVec2::new(664, 284)));
        let pixels = 2 * division.wide.size.element_product();
        assert!((f64::from(pixels) / (1680.0 * 1760.0) - 0.405).abs() < 0.01, "{pixels}");
    }

    #[test]
    fn the_inset_stays_in_the_image() {
        for principal in [vec2(-300.0, 20.0), vec2(1675.0, 5000.0)] {
            let view = View { principal, ..eye() };
            let Division { inset, offset, .. } = Division::new(&view, 0.45);
            assert!((offset + inset.size).cmple(view.size).all(), "{offset} {}", inset.size);
        }
        for size in [UVec2::ONE, UVec2::new(5, 3), UVec2::new(320, 240)] {
            let view = View { size, ..eye() };
            let Division { inset, offset, .. } = Division::new(&view, 0.35);
            assert!((offset + inset.size).cmple(size).all() && inset.size.min_element() > 0, "{size}");
        }
    }
}

//! The window's icon: three Gaussians, drawn in code.

use winit::window::Icon;

/// Edge of the icon in pixels.
const SIZE: u32 = 64;

/// Centre and standard deviation as fractions of the edge, and colour, back to front.
const BLOBS: [([f32; 2], f32, [f32; 3]); 3] = [
    ([0.36, 0.40], 0.17, [0.98, 0.45, 0.22]),
    ([0.64, 0.44], 0.15, [0.25, 0.62, 0.98]),
    ([0.50, 0.66], 0.14, [0.98, 0.85, 0.35]),
];

/// Draws the icon; `None` if the platform refuses it.
pub(crate) fn icon() -> Option<Icon> {
    Icon::from_rgba(pixels(), SIZE, SIZE).ok()
}

/// Straight-alpha RGBA, row by row.
fn pixels() -> Vec<u8> {
    let mut pixels = Vec::with_capacity((SIZE * SIZE * 4) as usize);
    for y in 0..SIZE {
        for x in 0..SIZE {
            let at = [x, y].map(|c| (c as f32 + 0.5) / SIZE as f32);
            let (mut color, mut coverage) = ([0.0; 3], 0.0);
            for (center, sigma, blob) in BLOBS {
                let squared = (at[0] - center[0]).powi(2) + (at[1] - center[1]).powi(2);
                let alpha = (1.6 * (-squared / (2.0 * sigma * sigma)).exp()).min(1.0);
                for channel in 0..3 {
                    color[channel] = color[channel] * (1.0 - alpha) + blob[channel] * alpha;
                }
                coverage = coverage * (1.0 - alpha) + alpha;
            }
            let straight = color.map(|c: f32| if coverage > 0.0 { c / coverage } else { 0.0 });
            pixels.extend(straight.map(|c| (c * 255.0).round() as u8));
            pixels.push((coverage * 255.0).round() as u8);
        }
    }
    pixels
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_icon_is_opaque_inside_and_transparent_at_the_corners() {
        let pixels = pixels();
        assert!(icon().is_some());
        let alpha = |x: u32, y: u32| pixels[((y * SIZE + x) * 4 + 3) as usize];
        assert_eq!(alpha(SIZE / 2, SIZE / 2), 255);
        for (x, y) in [(0, 0), (SIZE - 1, 0), (0, SIZE - 1), (SIZE - 1, SIZE - 1)] {
            assert!(alpha(x, y) < 24, "corner {x} {y}: {}", alpha(x, y));
        }
    }
}

//! [`DepthMap`].

/// Depths seen by the pixels of a photograph.
#[derive(Clone, Debug, PartialEq)]
pub struct DepthMap {
    /// Width in pixels; may differ from the photograph's.
    pub width: u32,
    /// Height in pixels.
    pub height: u32,
    /// Distance along the camera's axis (z, not the length of the ray), row by row from the top
    /// left, in units of the capture once aligned. Values that are 0, negative or not finite mean
    /// unknown.
    pub depths: Vec<f32>,
}

impl DepthMap {
    /// Depth seen by pixel `(x, y)` of a photograph of `size`; `None` if unknown.
    ///
    /// Takes the nearest pixel of the map. Interpolation would invent depths between the subject's
    /// edge and the background.
    pub fn at(&self, [x, y]: [u32; 2], size: [u32; 2]) -> Option<f32> {
        let scaled = |at: u32, from: u32, to: u32| {
            ((2 * u64::from(at) + 1) * u64::from(to) / (2 * u64::from(from))).min(u64::from(to.max(1)) - 1)
        };
        let column = scaled(x, size[0], self.width) as usize;
        let row = scaled(y, size[1], self.height) as usize;
        let depth = *self.depths.get(row * self.width as usize + column)?;
        (depth > 0.0 && depth.is_finite()).then_some(depth)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_nearest_pixel_of_another_size_counts() {
        let map = DepthMap { width: 2, height: 1, depths: vec![1.0, 2.0] };
        let row = |width: u32| (0..width).map(|x| map.at([x, 0], [width, 3]).unwrap()).collect::<Vec<_>>();
        assert_eq!(row(2), [1.0, 2.0]);
        assert_eq!(row(6), [1.0, 1.0, 1.0, 2.0, 2.0, 2.0]);
        assert_eq!(row(1), [2.0]);
    }

    #[test]
    fn what_is_no_depth_is_unknown() {
        let map = DepthMap { width: 4, height: 1, depths: vec![0.0, -1.0, f32::NAN, f32::INFINITY] };
        assert!((0..4).all(|x| map.at([x, 0], [4, 1]).is_none()));
        for broken in
            [DepthMap { depths: vec![], ..map }, DepthMap { width: 0, height: 0, depths: vec![1.0] }]
        {
            assert!(broken.width == 0 || broken.at([3, 0], [4, 1]).is_none());
            let _ = broken.at([0, 0], [4, 1]);
        }
    }
}

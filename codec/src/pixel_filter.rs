//! [`PixelFilter`]: the low-pass filter with which the images of a field's Gaussians are drawn.

/// The low-pass filter of a field: what is added to the covariance of a Gaussian's image, so that no
/// Gaussian falls between pixels, and whether its opacity makes up for it.
///
/// The parameters of a fitted field are right for the filter it was fitted with, and for no other.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Hash)]
#[cfg_attr(feature = "serde", derive(serde::Serialize, serde::Deserialize))]
pub enum PixelFilter {
    /// 0.3 px^2, as in 3D Gaussian Splatting (`classic` in gsplat): a Gaussian smaller than a pixel
    /// covers as much as one of a pixel, so a field is right near the resolution it was fitted at.
    #[default]
    Blur,
    /// 0.1 px^2 with compensated opacity, the 2D filter of Mip-Splatting (Yu et al. 2024; `mip` in
    /// Brush): opacity is multiplied by the root of the ratio of the covariance's determinants
    /// without and with the filter, so a Gaussian covers as much at any resolution. `antialiased` in
    /// gsplat and `--antialiasing` in 3D Gaussian Splatting do the same with 0.3 px^2.
    Mip,
}

impl PixelFilter {
    /// All filters.
    pub const ALL: [PixelFilter; 2] = [PixelFilter::Blur, PixelFilter::Mip];

    /// Added to both variances of an image, in px^2.
    pub const fn variance(self) -> f64 {
        match self {
            PixelFilter::Blur => 0.3,
            PixelFilter::Mip => 0.1,
        }
    }

    /// Whether opacity is multiplied by `sqrt(det(C) / det(C + variance I))`, with the covariance `C` of the
    /// image.
    pub const fn compensates(self) -> bool {
        matches!(self, PixelFilter::Mip)
    }

    /// Name in field files and reports: `blur` or `mip`.
    pub const fn name(self) -> &'static str {
        match self {
            PixelFilter::Blur => "blur",
            PixelFilter::Mip => "mip",
        }
    }

    /// The filter with this [`PixelFilter::name`].
    pub fn named(name: &str) -> Option<PixelFilter> {
        PixelFilter::ALL.into_iter().find(|filter| filter.name() == name)
    }
}

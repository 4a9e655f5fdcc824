//! What a PLY can say: its columns, elements and comments.

use crate::statements::{Statement, honoured, ignored, noted};

/// The columns and comments that are known.
pub(crate) const STATEMENTS: &[Statement] = &[
    honoured("x y z", "centre; relative to another origin where `f32` is too coarse"),
    honoured("f_dc_* f_rest_*", "colour as SH; SH above degree 3 is left out"),
    honoured("red green blue", "colour, where there is no `f_dc_*`"),
    honoured("opacity scale_* rot_*", "opacity, scales, rotation; without `scale_2` discs"),
    honoured(
        "filter_3D",
        "Mip-Splatting's filter in space; with the mip filter, unless a comment names another",
    ),
    honoured("packed_* min_* max_*", "compressed PLY"),
    honoured("trbf_center trbf_scale motion_* omega_*", "Spacetime Gaussians; field file"),
    honoured("t time duration dt vx vy vz velocity_*", "FreeTimeGS"),
    honoured("rot_r_*", "4DGS, with `t` and `scale_t`"),
    honoured("aarc_opacity tau s rot_rate_*", "field file"),
    honoured(
        "scalar_* scal_*",
        "CloudCompare, 3dgsconverter: the columns above, where all but the centre have the prefix",
    ),
    ignored("nx ny nz", "normals, which 3D Gaussian Splatting fills with zeros"),
    noted("any other column, any other element", "not read, as are columns that another format has"),
    honoured("comment aarc", "metadata of a [field file](FIELD.md)"),
    honoured("comment SplatRenderMode", "Brush: the filter"),
    honoured("comment antialiased", "Postshot: the filter, without its variance"),
    honoured(
        "comment Vertical Axis",
        "nerfstudio: the up axis, a letter or a vector; Brush's letter, which is always y, is noted",
    ),
    ignored("any other comment, obj_info", "free text"),
];

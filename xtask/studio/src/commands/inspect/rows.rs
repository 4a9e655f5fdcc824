//! Parts of the JSON that clips and takes share.

use codec::Viewpoint;
use serde::Serialize;

#[derive(Serialize)]
pub(super) struct ViewpointRow {
    pub(super) name: String,
    pub(super) position: [f32; 3],
    pub(super) target: [f32; 3],
    pub(super) fov_y_deg: f32,
}

#[derive(Serialize)]
pub(super) struct Plate {
    pub(super) gaussians: usize,
    pub(super) sh_degree: u8,
    pub(super) filter: &'static str,
}

impl From<&Viewpoint> for ViewpointRow {
    fn from(viewpoint: &Viewpoint) -> ViewpointRow {
        ViewpointRow {
            name: viewpoint.name.clone(),
            position: viewpoint.position,
            target: viewpoint.target,
            fov_y_deg: viewpoint.fov_y.to_degrees(),
        }
    }
}

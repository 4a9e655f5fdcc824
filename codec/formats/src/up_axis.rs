//! The up axis of a scene: [`up_of`] its cameras, or else [`DEFAULT_UP`].

use codec::Camera;

/// Default up axis: the up axis of upright cameras in COLMAP's and OpenCV's axes.
pub const DEFAULT_UP: [f32; 3] = [0.0, -1.0, 0.0];

/// The up axis of formats that fix it: glTF and SPZ.
pub(crate) const Y_UP: [f32; 3] = [0.0, 1.0, 0.0];

/// Mean up direction of cameras, snapped to an axis within about 25 degrees, since cameras are rarely exactly level;
/// `None` if they cancel out or there are none.
pub fn up_of<'a>(cameras: impl IntoIterator<Item = &'a Camera>) -> Option<[f32; 3]> {
    let mut up = [0.0; 3];
    for camera in cameras {
        (0..3).for_each(|axis| up[axis] -= camera.camera_from_world[1][axis]);
    }
    let length = up.iter().map(|x| x * x).sum::<f64>().sqrt();
    (length > 1e-6).then(|| {
        let up = up.map(|x| (x / length) as f32);
        let nearly = (0..3).find(|&axis| up[axis].abs() > 0.9);
        nearly.map_or(up, |axis| std::array::from_fn(|i| if i == axis { up[axis].signum() } else { 0.0 }))
    })
}

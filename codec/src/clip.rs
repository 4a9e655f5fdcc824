//! [`Clip`]: a decoded package, and [`Layers`], which continue it.

use crate::camera::{cross, norm};
use crate::format::{NAME_BYTES_MAX, VIEWPOINTS_MAX};
use crate::{Camera, Field, PixelFilter, Temporal, TimeIndex, sh_coefficients};

/// Metadata of a clip: everything a player needs besides the Gaussians.
#[derive(Clone, Debug, PartialEq)]
pub struct ClipInfo {
    /// Duration in seconds, above 0: the time from clip time 0 to clip time 1.
    pub duration_s: f32,
    /// Captured frames per second, above 0; one frame is the step of a frame-by-frame control.
    pub fps: f32,
    /// Unit vector that points up, in the axes of the source.
    pub up: [f32; 3],
    /// Metres per unit of length of the source, above 0: the scale of life size.
    pub metres_per_unit: f32,
    /// Suggested viewpoints, at most 64; playing starts from the first. May be empty.
    pub viewpoints: Vec<Viewpoint>,
}

impl Default for ClipInfo {
    /// One second at 30 frames per second, y down as in OpenCV, one metre per unit of length, no viewpoints.
    fn default() -> ClipInfo {
        ClipInfo {
            duration_s: 1.0,
            fps: 30.0,
            up: [0.0, -1.0, 0.0],
            metres_per_unit: 1.0,
            viewpoints: Vec::new(),
        }
    }
}

impl ClipInfo {
    /// Checks the ranges that the format requires, for reading and writing alike.
    ///
    /// # Errors
    /// Name and value of the first number or text out of range.
    pub fn check(&self) -> Result<(), (&'static str, String)> {
        let check = |valid: bool, field, value: &dyn std::fmt::Debug| {
            if valid { Ok(()) } else { Err((field, format!("{value:?}"))) }
        };
        let positive = |x: f32| x.is_finite() && x > 0.0;
        check(positive(self.duration_s), "duration", &self.duration_s)?;
        check(positive(self.fps), "frames per second", &self.fps)?;
        let norm = self.up.iter().map(|x| f64::from(*x).powi(2)).sum::<f64>().sqrt();
        check((norm - 1.0).abs() < 1e-3, "up vector (must have length 1)", &self.up)?;
        check(positive(self.metres_per_unit), "metres per unit", &self.metres_per_unit)?;
        let count = self.viewpoints.len();
        check(count <= VIEWPOINTS_MAX, "number of viewpoints (at most 64)", &count)?;
        for Viewpoint { name, position, target, fov_y } in &self.viewpoints {
            // Names reach terminals and menus, where control characters can do harm.
            let printable = name.len() <= NAME_BYTES_MAX && !name.chars().any(char::is_control);
            check(printable, "name of a viewpoint (at most 63 bytes, no control characters)", name)?;
            check(position.iter().all(|x| x.is_finite()), "position of a viewpoint", position)?;
            check(target.iter().all(|x| x.is_finite()), "target of a viewpoint", target)?;
            check(*fov_y > 0.0 && *fov_y < std::f32::consts::PI, "field of view of a viewpoint", fov_y)?;
        }
        Ok(())
    }
}

/// A named view of a clip, in the axes and units of the source.
#[derive(Clone, Debug, PartialEq)]
pub struct Viewpoint {
    /// Name for menus and `--view`: at most 63 bytes of UTF-8 without control characters.
    pub name: String,
    /// Position of the eye.
    pub position: [f32; 3],
    /// Point looked at, and pivot of an orbit.
    pub target: [f32; 3],
    /// Vertical field of view in radians, between 0 and pi.
    pub fov_y: f32,
}

impl Viewpoint {
    /// Returns a viewpoint named "front" from which the box `bounds`, `[min, max]`, fills the view.
    ///
    /// The source's x axis points right (z, if `up` is along x): the view is along -z if y points up
    /// (OpenGL, glTF), along +z if y points down (OpenCV), along +y if z points up. `bounds` may be
    /// empty; its coordinates must be finite and at most 1e37.
    pub fn framing(bounds: [[f32; 3]; 2], up: [f32; 3]) -> Viewpoint {
        let up = up.map(f64::from);
        // Rows: right, down, forward.
        let right = if up[0].abs() < 0.99 * norm(up) { [1.0, 0.0, 0.0] } else { [0.0, 0.0, 1.0] };
        Viewpoint::framing_along(cross(up, right), bounds, up)
    }

    /// As [`Viewpoint::framing`], in the direction `forward`.
    pub(crate) fn framing_along(forward: [f64; 3], bounds: [[f32; 3]; 2], up: [f64; 3]) -> Viewpoint {
        let [low, high] = bounds.map(|corner| corner.map(f64::from));
        let center: [f64; 3] = std::array::from_fn(|axis| 0.5 * (low[axis] + high[axis]));
        let half: [f64; 3] = std::array::from_fn(|axis| 0.5 * (high[axis] - low[axis]).abs());
        let axes = Camera::look_at([0.0; 3], forward, up, FRAMING_FOV_Y, 1, 1).camera_from_world;
        let [x, y, z] =
            [0, 1, 2].map(|row| (0..3).map(|axis| axes[row][axis].abs() * half[axis]).sum::<f64>());
        // The near side of the box fills the view, with a margin.
        let framing = FRAMING_MARGIN * x.max(y) / libm::tan(0.5 * FRAMING_FOV_Y) + z;
        let distance = if framing > 0.0 { framing } else { 1.0 };
        let position = std::array::from_fn(|axis| (center[axis] - distance * axes[2][axis]) as f32);
        let target = center.map(|x| x as f32);
        Viewpoint { name: "front".into(), position, target, fov_y: FRAMING_FOV_Y as f32 }
    }

    /// Returns the camera of this viewpoint for an image of `width` by `height` pixels; `up` is
    /// [`ClipInfo::up`].
    pub fn camera(&self, up: [f32; 3], width: u32, height: u32) -> Camera {
        Camera::look_at(
            self.position.map(f64::from),
            self.target.map(f64::from),
            up.map(f64::from),
            f64::from(self.fov_y),
            width,
            height,
        )
    }
}

/// Vertical field of view of [`Viewpoint::framing`], in radians.
pub(crate) const FRAMING_FOV_Y: f64 = 50.0 * std::f64::consts::PI / 180.0;

/// Size of the view of [`Viewpoint::framing`], relative to the box.
const FRAMING_MARGIN: f64 = 1.1;

/// A decoded package.
///
/// Gaussians lie in two regions, each a [`Field`]: the static ones, which are always on and never
/// move, and the dynamic ones. The rows of both are ordered by layer: layer 0 holds the most
/// important Gaussians, and the first `k` layers together are a complete, coarser clip.
#[derive(Clone, Debug, PartialEq)]
pub struct Clip {
    /// Duration, axes, viewpoints.
    pub info: ClipInfo,
    /// Corners `[min, max]` of the box around all centres while alive, in source units, to within
    /// the coder's rounding.
    pub bounds: [[f32; 3]; 2],
    /// Gaussians that are always on and motionless. Without temporal columns.
    pub static_field: Field,
    /// Gaussians with a temporal window, motion or rotation rate. Always with temporal columns.
    pub dynamic_field: Field,
    /// Gaussians up to the end of each decoded layer. Never empty.
    pub layers: Vec<LayerEnd>,
    /// Gaussians up to the end of each layer of the whole package: the entries of `layers`, and more if a prefix was
    /// decoded.
    pub layers_announced: Vec<LayerEnd>,
    /// Rows of `dynamic_field` that can be alive at a given time.
    pub time_index: TimeIndex,
    /// Static background, drawn behind everything else. Without temporal columns.
    pub plate: Option<Field>,
}

/// Layers of a package without the layers before them, see [`Contents::decode_layers`](crate::Contents::decode_layers).
#[derive(Clone, Debug, PartialEq)]
pub struct Layers {
    /// Gaussians of the layers before, which are not in it.
    pub before: LayerEnd,
    /// Rows of these layers in [`Clip::static_field`].
    pub static_field: Field,
    /// Rows of these layers in [`Clip::dynamic_field`].
    pub dynamic_field: Field,
    /// Gaussians up to the end of each of these layers, Gaussians of earlier layers included.
    pub ends: Vec<LayerEnd>,
    /// Rows of `dynamic_field` that can be alive at a given time.
    pub time_index: TimeIndex,
}

/// Numbers of Gaussians in a layer and all layers before it.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct LayerEnd {
    /// Number of rows of [`Clip::static_field`].
    pub static_count: usize,
    /// Number of rows of [`Clip::dynamic_field`].
    pub dynamic_count: usize,
}

impl LayerEnd {
    /// Numbers of Gaussians before layer `first`, counted from 0, of the layers with these ends.
    ///
    /// # Panics
    /// If there are fewer than `first` layers.
    pub fn before(ends: &[LayerEnd], first: usize) -> LayerEnd {
        first.checked_sub(1).map_or(LayerEnd::default(), |last| ends[last])
    }

    /// Number of Gaussians, static and dynamic, without the plate.
    pub fn total(self) -> usize {
        self.static_count + self.dynamic_count
    }
}

impl Clip {
    /// A clip of one layer that came without a package. Its time index excludes no row. `bounds` are the corners of the box
    /// around all centres while alive; `dynamic_field` has temporal columns, the others have none.
    pub fn of_one_layer(
        info: ClipInfo,
        bounds: [[f32; 3]; 2],
        static_field: Field,
        dynamic_field: Field,
        plate: Option<Field>,
    ) -> Clip {
        let end = LayerEnd { static_count: static_field.len(), dynamic_count: dynamic_field.len() };
        Clip {
            info,
            bounds,
            time_index: TimeIndex::of_candidates(dynamic_field.len()),
            static_field,
            dynamic_field,
            layers: vec![end],
            layers_announced: vec![end],
            plate,
        }
    }

    /// Adds layers that were decoded without the layers of this clip. The clip then equals the clip that decoding all
    /// layers at once makes.
    ///
    /// # Panics
    /// If they do not follow the last layer of this clip, or have other columns.
    pub fn append(&mut self, further: Layers) {
        let Layers { before, static_field, dynamic_field, ends, time_index } = further;
        assert_eq!(self.layers.last(), Some(&before), "further layers follow the last one");
        assert!(self.dynamic_field.has_columns_of(&dynamic_field), "further layers have the same columns");
        self.static_field.append(static_field);
        self.dynamic_field.append(dynamic_field);
        self.layers.extend(ends);
        self.time_index.append(time_index);
    }

    /// Both regions as one field, static Gaussians first, without the plate.
    pub fn merged(&self) -> Field {
        let (first, second) = (&self.static_field, &self.dynamic_field);
        let both = |a: &[[f32; 3]], b: &[[f32; 3]]| [a, b].concat();
        let sh_degree = self.sh_degree();
        Field {
            centers: both(&first.centers, &second.centers),
            rotations: [&first.rotations[..], &second.rotations].concat(),
            log_scales: both(&first.log_scales, &second.log_scales),
            opacities: [&first.opacities[..], &second.opacities].concat(),
            sh_degree,
            sh: both(&sh_at_degree(first, sh_degree), &sh_at_degree(second, sh_degree)),
            filter: self.filter(),
            near: self.near(),
            temporal: second.temporal.as_ref().filter(|_| !second.is_empty()).map(|temporal| {
                let n = first.len();
                Temporal {
                    tau: [&vec![0.0; n][..], &temporal.tau].concat(),
                    s: [&vec![f32::INFINITY; n][..], &temporal.s].concat(),
                    motion_order: temporal.motion_order,
                    motion: both(&vec![[0.0; 3]; n * usize::from(temporal.motion_order)], &temporal.motion),
                    rotation_rates: temporal
                        .rotation_rates
                        .as_ref()
                        .map(|rates| [&vec![[0.0; 4]; n][..], rates].concat()),
                }
            }),
        }
    }

    /// Number of Gaussians without the plate.
    pub fn len(&self) -> usize {
        self.static_field.len() + self.dynamic_field.len()
    }

    /// Whether the clip has no Gaussians.
    pub fn is_empty(&self) -> bool {
        self.len() == 0
    }

    /// The filter of both regions; the plate has its own.
    pub fn filter(&self) -> PixelFilter {
        if self.dynamic_field.is_empty() { self.static_field.filter } else { self.dynamic_field.filter }
    }

    /// [`Field::near`] of both regions and the plate.
    pub fn near(&self) -> f32 {
        if self.dynamic_field.is_empty() { self.static_field.near } else { self.dynamic_field.near }
    }

    /// Degree of the spherical harmonics of both regions, 0 to 3.
    pub fn sh_degree(&self) -> u8 {
        self.dynamic_field.sh_degree.max(self.static_field.sh_degree)
    }
}

/// The SH column of a field, widened with zeros to `degree`.
fn sh_at_degree(field: &Field, degree: u8) -> Vec<[f32; 3]> {
    let mut sh = Vec::with_capacity(field.len() * sh_coefficients(degree));
    for i in 0..field.len() {
        sh.extend_from_slice(field.sh_of(i));
        sh.resize((i + 1) * sh_coefficients(degree), [0.0; 3]);
    }
    sh
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Projection of a world point to a square image of side 1, and its depth.
    fn project(viewpoint: &Viewpoint, up: [f32; 3], point: [f32; 3]) -> [f64; 3] {
        let camera = viewpoint.camera(up, 1, 1);
        camera.check().unwrap();
        let p = point.map(f64::from);
        let [x, y, z] = [0, 1, 2].map(|r| {
            let m = camera.camera_from_world[r];
            m[0] * p[0] + m[1] * p[1] + m[2] * p[2] + m[3]
        });
        [camera.k[0][0] * x / z + camera.k[0][2], camera.k[1][1] * y / z + camera.k[1][2], z]
    }

    #[test]
    fn framing_fills_the_view_and_points_up() {
        let bounds = [[-1.0, -3.0, -0.5], [2.0, 1.0, 5.0]];
        let [a, b] = bounds;
        for (up, forward) in [
            ([0.0, 1.0, 0.0], [0.0, 0.0, -1.0]),
            ([0.0, -1.0, 0.0], [0.0, 0.0, 1.0]),
            ([0.0, 0.0, 1.0], [0.0, 1.0, 0.0]),
            ([1.0, 0.0, 0.0], [0.0, -1.0, 0.0]),
        ] {
            let viewpoint = Viewpoint::framing(bounds, up);
            let mut largest = 0.0f64;
            for corner in 0..8 {
                let point = [0, 1, 2].map(|axis| if corner >> axis & 1 == 0 { a[axis] } else { b[axis] });
                let [x, y, z] = project(&viewpoint, up, point);
                assert!(z > 0.0);
                largest = largest.max((x - 0.5).abs()).max((y - 0.5).abs());
            }
            assert!((0.4..0.5).contains(&largest), "up {up:?}: the box extends to {largest} of 0.5");
            let target = viewpoint.target;
            let above = [0, 1, 2].map(|axis| target[axis] + up[axis]);
            assert!(project(&viewpoint, up, above)[1] < 0.49, "up {up:?} is up in the image");
            for axis in 0..3 {
                let toward = target[axis] - viewpoint.position[axis];
                assert!((toward > 0.1) == (forward[axis] > 0.0) && (toward < -0.1) == (forward[axis] < 0.0));
            }
        }
    }

    #[test]
    fn framing_a_point_keeps_one_unit_of_distance() {
        let viewpoint = Viewpoint::framing([[3.0; 3]; 2], [0.0, 1.0, 0.0]);
        assert_eq!((viewpoint.position, viewpoint.target), ([3.0, 3.0, 4.0], [3.0; 3]));
    }
}

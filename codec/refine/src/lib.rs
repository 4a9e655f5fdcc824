//! Makes fields of 4D Gaussians and prunes them: the host's half of the project.
//!
//! | module | from | to |
//! |---|---|---|
//! | [`capture`] | calibrated cameras and photographs | the splits to fit to and to evaluate by |
//! | [`matte`] | pictures of a static camera | its clean plate, and the alpha of the subject |
//! | [`mod@anchor`] | photographs of each frame | [`fit::Parameters`] on the subject's surface |
//! | [`fit`] | parameters and training views | a [`codec::Field`] |
//! | [`prune`] | a field and a budget | the rows to retain, and their colours |
//! | [`mod@code`] | the pruned field and a target PSNR | a package |
//! | [`reference`](mod@reference) | a field, clip or scene, a camera and a time | an [`image::Image`] |
//! | [`metrics`] | a picture and a photograph | PSNR, SSIM and LPIPS |
//!
//! Each stage is a function of values. None reads or writes files, and no result depends on the number of
//! threads. Lengths are in units of the capture, clip times in 0 to 1, and colours display-referred.
//!
//! # Example
//!
//! Anchors a white ball that eight cameras photographed, fits it for two steps, and prunes it to 100 Gaussians:
//!
//! ```
//! use codec::Camera;
//! use refine::anchor::{AnchorError, AnchorFrame, AnchorSettings, AnchorView, anchor};
//! use refine::fit::{Cpu, Fit, FitSettings, Photograph, Run, Timeline, TrainingView};
//! use refine::prune::{Floor, FloorSettings, Ranking, by_importance};
//!
//! let view = |camera_id: usize| {
//!     let (sin, cos) = (std::f64::consts::TAU * camera_id as f64 / 8.0).sin_cos();
//!     let camera = Camera::look_at([3.0 * sin, 0.3, 3.0 * cos], [0.0; 3], [0.0, 1.0, 0.0], 0.7, 32, 32);
//!     let is_ball = |pixel: i32| (pixel % 32 - 16).pow(2) + (pixel / 32 - 16).pow(2) < 64;
//!     let pixels = (0..32 * 32).map(|pixel| if is_ball(pixel) { [255; 4] } else { [0; 4] }).collect();
//!     let photograph = Photograph { width: 32, height: 32, pixels, valid: Vec::new() };
//!     AnchorView { camera_id, camera, photograph, depths: None }
//! };
//! let views: Vec<AnchorView> = (0..8).map(view).collect();
//!
//! let timeline = Timeline::even(1);
//! let settings = AnchorSettings { gaussians: 400, ..AnchorSettings::default() };
//! let frame = AnchorFrame { frame: 0, time: 0.0, views: views.clone() };
//! let parameters = anchor(&settings, timeline, [Ok::<_, AnchorError>(frame)].into_iter())?;
//!
//! let training_view =
//!     |view: AnchorView| TrainingView {
//!         camera_id: view.camera_id,
//!         camera: view.camera,
//!         time: 0.0,
//!         photograph: view.photograph,
//!     };
//! let training: Vec<TrainingView> = views.into_iter().map(training_view).collect();
//! let settings = FitSettings { steps: 2, ..FitSettings::default() };
//! let fit = Fit::new(settings, parameters, timeline, training.iter().map(|view| &view.camera));
//! let mut backend = Cpu::default();
//! let mut run = Run::start(fit, &mut backend)?;
//! while !run.is_done() {
//!     run.step(&training.iter().collect::<Vec<_>>(), None)?;
//! }
//! let field = run.pause()?.to_field();
//!
//! let order = by_importance(&Ranking::Mass.scores(&field, &[]));
//! let retained = Floor::new(&field, FloorSettings::default()).enforce(&order, 100, || ());
//! assert_eq!(field.select(&retained.rows).len(), 100);
//! # Ok::<(), Box<dyn std::error::Error>>(())
//! ```
#![forbid(unsafe_code)]

pub mod anchor;
pub mod capture;
pub mod code;
mod color_alignment;
pub mod fit;
pub mod image;
mod in_order;
pub mod matte;
mod median;
pub mod metrics;
pub mod prune;
mod raster;
pub mod reference;
mod temporal_median;

//! Makes fields of 4D Gaussians and prunes them: the host's half of the project.
//!
//! | module | from | to |
//! |---|---|---|
//! | [`capture`] | calibrated cameras and photographs | the splits to fit to and to evaluate by |
//! | [`mod@anchor`] | photographs of each frame | [`fit::Parameters`] on the subject's surface |
//! | [`fit`] | parameters and training views | a [`codec::Field`] |
//! | [`prune`] | a field and a budget | the rows to retain, and their colours |
//! | [`mod@code`] | the pruned field and a target PSNR | a package |
//! | [`reference`](mod@reference) | a field, clip or scene, a camera and a time | an [`image::Image`] |
//! | [`metrics`] | a picture and a photograph | PSNR, SSIM and LPIPS |
//!
//! Each stage is a function of values. None reads or writes files, and no result depends on the number of
//! threads. Lengths are in units of the capture, clip times in 0 to 1, and colours display-referred.
#![forbid(unsafe_code)]

pub mod anchor;
pub mod capture;
pub mod code;
pub mod fit;
pub mod image;
mod median;
pub mod metrics;
pub mod prune;
pub mod reference;

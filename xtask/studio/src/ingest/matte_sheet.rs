//! The part of the page that shows plates and mattes.

use std::fmt::Write as _;

use super::findings::{IngestFindings, percent};
use super::mattes::CameraMattes;
use super::plates::PlateSource;
use crate::page::escape;

/// For each camera its plate, a few pictures with darkened backgrounds, and the share of the subject.
pub(super) fn section(findings: &IngestFindings, mattes: &[CameraMattes]) -> String {
    let mut text = String::from(
        "<p>Left the plate of each camera, which should not show the subject, then pictures in which everything but the \
         subject is darkened. What is dark of the subject is missing; what is bright besides it, such as a shadow, or where the plate \
         shows the subject, is too much.</p>\n",
    );
    for (camera, mattes) in findings.cameras.iter().zip(mattes) {
        let source = match mattes.source {
            PlateSource::Median => "plate: median of the video",
            PlateSource::EmptyVideo => "plate: median of a video without the subject",
            PlateSource::EmptyPicture => "plate: a picture without the subject",
        };
        let gains = mattes.gains.map(|gain| format!("{gain:.3}")).join(", ");
        let _ = write!(
            text,
            "<h3>{}</h3>\n<p>Pictures are {gains} times as bright as the plate in red, green and blue.{}</p>\n<div class=side-by-side>",
            escape(&camera.name),
            shares(mattes)
        );
        for (i, thumbnail) in mattes.thumbnails.iter().enumerate() {
            let caption = if i == 0 { source } else { "" };
            let _ = write!(
                text,
                "<figure style=\"flex-basis:255px\"><img alt=\"\" src=\"data:image/jpeg;base64,{thumbnail}\"><figcaption>{caption}</figcaption></figure>"
            );
        }
        text += "</div>\n";
    }
    text
}

/// A sentence about the shares of the subject in the pictures.
fn shares(mattes: &CameraMattes) -> String {
    let Some(mean) = mattes.mean_share() else { return String::new() };
    let least = mattes.shares.iter().copied().fold(f64::INFINITY, f64::min);
    let most = mattes.shares.iter().copied().fold(0.0, f64::max);
    let [mean, least, most] = [mean, least, most].map(percent);
    format!(" The subject covers {mean} % of them, {least} to {most} %.")
}

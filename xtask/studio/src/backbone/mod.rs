//! [`Backbone`]: a depth network, as a folder of ONNX stages on ONNX Runtime.
//!
//! The stages are files that run one after the other; outputs of a stage are inputs of later ones, by
//! name. There is one session at a time, dropped before the next one is made, so that memory is bounded
//! by the largest stage and the values between stages. The format of the
//! folder is described in `xtask/CAPTURE.md`.

mod manifest;
mod runtime;

use std::collections::BTreeMap;
use std::fs;
use std::path::{Path, PathBuf};

use image::RgbImage;
use image::imageops::{FilterType, resize};
use ort::session::{Session, SessionInputValue};
use ort::value::{TensorElementType, TensorRef, ValueType};
use program::Fault;
use refine::anchor::DepthMap;

use crate::messages::{count, unreadable};
use manifest::Manifest;
use runtime::one_line;

/// A network that makes depth maps of photographs.
#[derive(Debug)]
pub struct Backbone {
    folder: PathBuf,
    manifest: Manifest,
    /// Files of the stages, in the order of their names.
    stages: Vec<PathBuf>,
    /// The stage that is loaded.
    loaded: Option<(usize, Session)>,
}

/// A value that passes between stages.
#[derive(Debug)]
struct Tensor {
    shape: Vec<i64>,
    values: Values,
}

#[derive(Debug)]
enum Values {
    Float(Vec<f32>),
    Whole(Vec<i64>),
}

/// Values so far, by name.
type Known = BTreeMap<String, Tensor>;

impl Backbone {
    /// Reads the manifest of `folder`, lists its stages and loads ONNX Runtime.
    ///
    /// # Errors
    /// [`Fault::Data`] if the folder is not a backbone, [`Fault::Device`] if there is no runtime, with the
    /// remedy.
    pub fn open(folder: &Path) -> Result<Backbone, Fault> {
        let manifest = Manifest::load(folder)?;
        let bad = |error: std::io::Error| unreadable(folder, &error);
        let mut stages = Vec::new();
        for entry in fs::read_dir(folder).map_err(bad)? {
            let path = entry.map_err(bad)?.path();
            stages.extend(Some(path).filter(|path| path.extension().is_some_and(|end| end == "onnx")));
        }
        stages.sort();
        if stages.is_empty() {
            return Err(Fault::Data(format!(
                "{}: no stage is there, as no file ends in .onnx; put the network's files there",
                folder.display()
            )));
        }
        runtime::environment()?;
        Ok(Backbone { folder: folder.to_owned(), manifest, stages, loaded: None })
    }

    /// Depth maps of photographs of one instant, in their order, each of the network's output size and up to
    /// a scale. Photographs are scaled to the network's input size one at a time.
    ///
    /// # Errors
    /// Errors of `photographs`; [`Fault::Data`] that names the stage and the mismatch.
    pub fn depths(
        &mut self,
        photographs: impl Iterator<Item = Result<RgbImage, Fault>>,
    ) -> Result<Vec<DepthMap>, Fault> {
        let Manifest { width, height, .. } = self.manifest;
        let planes = photographs.map(|photograph| {
            // A cubic filter as wide as an output pixel.
            let scaled = resize(&photograph?, width, height, FilterType::CatmullRom);
            Ok(self.manifest.planes(&scaled))
        });
        let planes: Vec<Vec<f32>> = planes.collect::<Result<_, Fault>>()?;
        let together = if self.manifest.together { planes.len().max(1) } else { 1 };
        let batch = |planes: &[Vec<f32>]| {
            let shape = vec![planes.len() as i64, 3, i64::from(height), i64::from(width)];
            let image = Tensor { shape, values: Values::Float(planes.concat()) };
            Known::from([(self.manifest.input.clone(), image)])
        };
        let views: Vec<usize> = planes.chunks(together).map(<[_]>::len).collect();
        let mut batches: Vec<Known> = planes.chunks(together).map(batch).collect();
        drop(planes);
        for stage in 0..self.stages.len() {
            self.load(stage)?;
            for known in &mut batches {
                self.run(known)?;
            }
        }
        let mut maps = Vec::new();
        for (mut known, views) in batches.into_iter().zip(views) {
            let Some(depth) = known.remove(&self.manifest.output) else {
                let (folder, output) = (self.folder.display(), &self.manifest.output);
                return Err(Fault::Data(format!(
                    "{folder}: no stage gives \"{output}\"; name the depths as \"output\" in backbone.json"
                )));
            };
            maps.extend(self.maps(depth, views)?);
        }
        Ok(maps)
    }

    /// Makes the session of a stage after dropping the previous one. A network of one stage is loaded once.
    fn load(&mut self, stage: usize) -> Result<(), Fault> {
        if self.loaded.as_ref().is_none_or(|(loaded, _)| *loaded != stage) {
            self.loaded = None;
            let path = &self.stages[stage];
            let session = runtime::session(path).map_err(|error| {
                Fault::Data(format!("{}: {}; export the network again", path.display(), one_line(&error)))
            })?;
            self.loaded = Some((stage, session));
        }
        Ok(())
    }

    /// Runs the loaded stage and adds its outputs to the known values, replacing values of equal names.
    fn run(&mut self, known: &mut Known) -> Result<(), Fault> {
        let (stage, session) = self.loaded.as_mut().expect("a stage is loaded");
        let path = &self.stages[*stage];
        let bad = |what: String| Fault::Data(format!("{}: {what}", path.display()));
        let failed = |error: ort::Error| {
            bad(format!("{}; see that width and height are those of the network", one_line(&error)))
        };
        let mut inputs: Vec<(String, SessionInputValue)> = Vec::new();
        for input in session.inputs() {
            let name = input.name();
            let Some(Tensor { shape, values }) = known.get(name) else {
                let names: Vec<&str> = known.keys().map(String::as_str).collect();
                return Err(bad(format!(
                    "it takes \"{name}\", which no stage before it gives; rename it to one of {}",
                    names.join(", ")
                )));
            };
            let mut shape = shape.clone();
            // Networks of many views have another dimension for scenes.
            if name == self.manifest.input && rank(input.dtype()) == Some(5) {
                shape.insert(0, 1);
            }
            let value = match values {
                Values::Float(values) => TensorRef::from_array_view((shape, &values[..])).map(Into::into),
                Values::Whole(values) => TensorRef::from_array_view((shape, &values[..])).map(Into::into),
            };
            inputs.push((name.to_owned(), value.map_err(failed)?));
        }
        let outputs = session.run(inputs).map_err(failed)?;
        let mut given = Known::new();
        for (name, value) in outputs.iter() {
            let values = match value.dtype() {
                ValueType::Tensor { ty: TensorElementType::Float32, .. } => {
                    let (shape, values) = value.try_extract_tensor::<f32>().map_err(failed)?;
                    Tensor { shape: shape.to_vec(), values: Values::Float(values.to_vec()) }
                }
                ValueType::Tensor { ty: TensorElementType::Int64, .. } => {
                    let (shape, values) = value.try_extract_tensor::<i64>().map_err(failed)?;
                    Tensor { shape: shape.to_vec(), values: Values::Whole(values.to_vec()) }
                }
                _ => {
                    return Err(bad(format!(
                        "\"{name}\" is neither float32 nor int64; export the network with these types"
                    )));
                }
            };
            given.insert(name.to_owned(), values);
        }
        drop(outputs);
        known.extend(given);
        Ok(())
    }

    /// Splits an output into the maps of `views` photographs.
    fn maps(&self, Tensor { shape, values }: Tensor, views: usize) -> Result<Vec<DepthMap>, Fault> {
        let output = &self.manifest.output;
        let bad = |what: String| {
            let folder = self.folder.display();
            Fault::Data(format!(
                "{folder}: \"{output}\" {what}; export the network with depths as its output"
            ))
        };
        let Values::Float(values) = values else { return Err(bad("is not float32".into())) };
        // Channel, batch and scene dimensions may be 1.
        let sides: Vec<usize> = shape.iter().filter(|side| **side != 1).map(|side| *side as usize).collect();
        let [height, width] = match (views, &sides[..]) {
            (1, [height, width]) => [*height, *width],
            (_, [first, height, width]) if *first == views => [*height, *width],
            _ => {
                return Err(bad(format!(
                    "has the shape {shape:?}, and {} of height and width are expected",
                    count(views, "map")
                )));
            }
        };
        if width * height == 0 {
            return Err(bad(format!("has the shape {shape:?}, which is empty")));
        }
        let map =
            |depths: &[f32]| DepthMap { width: width as u32, height: height as u32, depths: depths.to_vec() };
        Ok(values.chunks(width * height).map(map).collect())
    }
}

/// Declared number of dimensions of a tensor.
fn rank(kind: &ValueType) -> Option<usize> {
    match kind {
        ValueType::Tensor { shape, .. } => Some(shape.len()),
        _ => None,
    }
}

//! [`Parameter`]: a setting that trades error for time or bytes, with the cost and error of each value.
//!
//! A point is on the Pareto front if no other point of its parameter is significantly better in cost or error
//! and no worse in the other. A cost is significantly lower if the interquartile ranges do not overlap, a
//! PSNR significantly higher by more than `RESOLUTION_DB`.

use std::collections::BTreeMap;

use refine::prune::RESOLUTION_DB;
use serde::{Deserialize, Serialize};

/// The stage that a parameter belongs to.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum FlowStage {
    /// Drawing a clip.
    Playing,
    /// Making a package of a field.
    Packaging,
    /// Making a field of a capture.
    Fitting,
}

/// A parameter, measured.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct Parameter {
    /// The stage that it belongs to.
    pub stage: FlowStage,
    /// Its name.
    pub name: String,
    /// What it does, in a sentence.
    pub about: String,
    /// Why its default stands where another value beats it on one clip: the clause after "because". Empty without
    /// a default.
    pub why_default: String,
    /// What a point costs, with the unit.
    pub cost: String,
    /// Its values, from one end to the other.
    pub points: Vec<ParameterValue>,
}

/// A value of a parameter, measured.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct ParameterValue {
    /// The value.
    pub value: String,
    /// Whether it is the default.
    pub default: bool,
    /// Whether no other value is better, see [`Parameter::mark_front`].
    pub on_front: bool,
    /// Cost in the unit of the parameter.
    pub cost: Quartiles,
    /// Error against the field.
    pub errors: ImageErrors,
    /// Milliseconds: of a frame where clips are played, of decoding where packages are made, of the
    /// fit so far where one is made.
    pub run_time_ms: Option<Quartiles>,
    /// Milliseconds of parts of it.
    pub stages_ms: BTreeMap<String, Quartiles>,
    /// Counts that are the same on every machine.
    pub counts: BTreeMap<String, f64>,
}

/// Errors of pictures against the reference.
#[derive(Clone, Copy, Debug, Default, PartialEq, Serialize, Deserialize)]
pub struct ImageErrors {
    /// PSNR in dB over all pixels of all pictures; `None` where they are the same.
    pub psnr_db: Option<f64>,
    /// Mean structural similarity.
    pub ssim: Option<f64>,
    /// PSNR in dB of the worst tile of 32 by 32 pixels of all pictures; `None` where it was not
    /// measured, or there is no error.
    pub worst_tile_db: Option<f64>,
    /// Root mean square of how the error changes from frame to frame while the head turns, in 255ths.
    pub flicker: Option<f64>,
}

/// Quartiles of several measurements.
#[derive(Clone, Copy, Debug, Default, PartialEq, Serialize, Deserialize)]
pub struct Quartiles {
    /// 25th percentile.
    pub low: f64,
    /// 50th percentile.
    pub median: f64,
    /// 75th percentile.
    pub high: f64,
}

impl Quartiles {
    /// Quartiles of `values`, in any order; 0 if empty.
    pub fn new(values: impl IntoIterator<Item = f64>) -> Quartiles {
        let mut sorted: Vec<f64> = values.into_iter().collect();
        sorted.sort_by(f64::total_cmp);
        let at = |part: f64| {
            let rank = (part * sorted.len() as f64).ceil() as usize;
            sorted.get(rank.saturating_sub(1)).copied().unwrap_or(0.0)
        };
        Quartiles { low: at(0.25), median: at(0.5), high: at(0.75) }
    }

    /// An exact value.
    pub fn exactly(value: f64) -> Quartiles {
        Quartiles { low: value, median: value, high: value }
    }
}

impl ParameterValue {
    /// A value with a PSNR in dB, infinite where there is no error, and without further errors and times.
    pub fn new(
        value: &str,
        default: bool,
        cost: Quartiles,
        psnr_db: f64,
        counts: &[(&str, f64)],
    ) -> ParameterValue {
        ParameterValue {
            value: value.to_owned(),
            default,
            on_front: false,
            cost,
            errors: ImageErrors { psnr_db: psnr_db.is_finite().then_some(psnr_db), ..ImageErrors::default() },
            run_time_ms: None,
            stages_ms: BTreeMap::new(),
            counts: counts.iter().map(|(name, count)| ((*name).to_owned(), *count)).collect(),
        }
    }

    /// PSNR in dB, infinite where there is no error.
    pub fn psnr_db(&self) -> f64 {
        self.errors.psnr_db.unwrap_or(f64::INFINITY)
    }

    fn is_cheaper(&self, other: &ParameterValue) -> bool {
        self.cost.high < other.cost.low
    }

    fn is_more_exact(&self, other: &ParameterValue) -> bool {
        // Infinity is not greater than infinity.
        self.psnr_db() > other.psnr_db() + RESOLUTION_DB
    }

    /// Whether it is better than `other` in cost or error and no worse in the other.
    fn beats(&self, other: &ParameterValue) -> bool {
        (self.is_cheaper(other) && !other.is_more_exact(self))
            || (self.is_more_exact(other) && self.cost.median <= other.cost.median)
    }
}

impl Parameter {
    /// The parameter with its front marked: the points that no other point of the front beats. A curve that rises in
    /// steps below the resolution so keeps each point at which it has risen by as much.
    pub fn mark_front(mut self) -> Parameter {
        let points = &self.points;
        let mut by_cost: Vec<usize> = (0..points.len()).collect();
        by_cost.sort_by(|&a, &b| {
            let [a, b] = [a, b].map(|i| &points[i]);
            a.cost.median.total_cmp(&b.cost.median).then(b.psnr_db().total_cmp(&a.psnr_db()))
        });
        // A point is beaten only by points before it.
        let mut front: Vec<usize> = Vec::new();
        for i in by_cost {
            if !front.iter().any(|&other| points[other].beats(&points[i])) {
                front.push(i);
            }
        }
        for (i, point) in self.points.iter_mut().enumerate() {
            point.on_front = front.contains(&i);
        }
        self
    }

    /// The defaults that are off the front, each with the points that beat it.
    pub fn beaten_defaults(&self) -> impl Iterator<Item = (&ParameterValue, Vec<&ParameterValue>)> {
        let off = self.points.iter().filter(|point| point.default && !point.on_front);
        off.map(|point| (point, self.points.iter().filter(|other| other.beats(point)).collect()))
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn point(value: &str, cost: [f64; 3], psnr_db: f64) -> ParameterValue {
        let [low, median, high] = cost;
        ParameterValue::new(value, value == "default", Quartiles { low, median, high }, psnr_db, &[])
    }

    fn front(points: Vec<ParameterValue>) -> (Vec<bool>, Parameter) {
        let parameter = Parameter {
            stage: FlowStage::Playing,
            name: "parameter".into(),
            about: String::new(),
            why_default: String::new(),
            cost: "ms".into(),
            points,
        }
        .mark_front();
        (parameter.points.iter().map(|point| point.on_front).collect(), parameter)
    }

    #[test]
    fn the_front_is_what_nothing_beats() {
        let cost = |c: f64| [c - 0.1, c, c + 0.1];
        let (on_front, parameter) = front(vec![
            point("exact", cost(9.0), f64::INFINITY),
            point("default", cost(8.0), 40.0),
            point("better", cost(7.0), 41.0),
            point("fast", cost(2.0), 30.0),
            point("worse", cost(2.5), 29.0),
        ]);
        assert_eq!(on_front, [true, false, true, true, false]);
        let (default, by) = parameter.beaten_defaults().next().unwrap();
        assert_eq!((default.value.as_str(), by.len(), by[0].value.as_str()), ("default", 1, "better"));
    }

    #[test]
    fn what_noise_can_explain_beats_nothing() {
        let (on_front, parameter) =
            front(vec![point("default", [6.0, 8.0, 9.0], 50.00), point("as fast", [6.5, 7.0, 8.0], 50.05)]);
        assert_eq!(on_front, [true, true]);
        assert_eq!(parameter.beaten_defaults().count(), 0);
        // Faster as far as one can tell, and less exact.
        let (on_front, _) =
            front(vec![point("default", [6.0, 8.0, 9.0], 50.0), point("b", [6.5, 7.0, 8.0], 48.0)]);
        assert_eq!(on_front, [true, true]);
        let (on_front, _) =
            front(vec![point("default", [6.0, 8.0, 9.0], 50.0), point("b", [6.5, 8.5, 9.0], 48.0)]);
        assert_eq!(on_front, [true, false]);
    }

    #[test]
    fn a_front_of_small_steps_reaches_the_best_point() {
        let step = |i: u32| {
            let cost = f64::from(i);
            point("", [cost; 3], 20.0 + 0.4 * f64::from(i) * RESOLUTION_DB)
        };
        let (on_front, _) = front((0..7).map(step).collect());
        assert_eq!(on_front, [true, false, false, true, false, false, true]);
    }

    #[test]
    fn spreads_by_rank() {
        let spread = Quartiles::new([7.0, 1.0, 3.0, 5.0]);
        assert_eq!(spread, Quartiles { low: 1.0, median: 3.0, high: 5.0 });
        assert_eq!(Quartiles::new([]), Quartiles::exactly(0.0));
    }
}

//! [`VARIANTS`]: the fits of the ablation, a row each.

use crate::fit::{Coarse, FitPlan, FitStart, PlatePlan};
use codec::PixelFilter;
use refine::anchor::Mirror;
use refine::fit::{DensityRule, Learned};

/// The fit that the variants are compared with.
#[derive(Clone, Debug)]
pub struct FullFit {
    /// Its plan, without an LPIPS term.
    pub plan: FitPlan,
    /// [`FitPlan::lpips`] of the weights, if they are given.
    pub lpips: Option<String>,
    /// Whether its anchor may be mirrored.
    pub mirrors: bool,
}

/// A fit of the ablation.
#[derive(Clone, Copy, Debug)]
pub struct Variant {
    /// Its name in tables, and of its folder, with hyphens for spaces.
    pub name: &'static str,
    /// What it changes.
    pub about: &'static str,
    /// Its plan; `None` if it would be the full fit.
    pub plan: fn(&FullFit) -> Option<FitPlan>,
    /// Why it has no plan.
    pub absent: &'static str,
}

/// The fits of the ablation, the full one first.
pub const VARIANTS: &[Variant] = &[
    Variant {
        name: "full",
        about: "the options of this report",
        plan: |full| Some(full.plan.clone()),
        absent: "",
    },
    Variant {
        name: "no anchor",
        about: "Gaussians start at random positions",
        plan: |full| Some(FitPlan { start: FitStart::Scatter, ..full.plan.clone() }),
        absent: "",
    },
    Variant {
        name: "no motion start",
        about: "Gaussians start at rest",
        plan: |full| full.plan.motion_start.then(|| FitPlan { motion_start: false, ..full.plan.clone() }),
        absent: "--set motion-start=off leaves it out of the full fit",
    },
    Variant {
        name: "blur",
        about: "--set filter=blur: that of 3D Gaussian Splatting",
        plan: |full| {
            let filter = PixelFilter::Blur;
            (full.plan.filter != filter).then(|| FitPlan { filter, ..full.plan.clone() })
        },
        absent: "the full fit has it, by --set filter=blur",
    },
    Variant {
        name: "no fragment term",
        about: "--set fragment-weight=0: nothing keeps Gaussians from covering pixels",
        plan: |full| {
            (full.plan.fragment_weight > 0.0).then(|| FitPlan { fragment_weight: 0.0, ..full.plan.clone() })
        },
        absent: "the full fit has none",
    },
    Variant {
        name: "fragment term doubled",
        about: "--set fragment-weight at twice that of the full fit, for headsets",
        plan: |full| {
            let fragment_weight = 2.0 * full.plan.fragment_weight;
            (fragment_weight > 0.0).then(|| FitPlan { fragment_weight, ..full.plan.clone() })
        },
        absent: "the full fit has none",
    },
    Variant {
        name: "paper's rule",
        about: "--rule paper: opacities are reset every 3000 steps, and there is no fragment term",
        plan: |full| Some(paper(full)),
        absent: "",
    },
    Variant {
        name: "paper's rule, no floor",
        about: "the same, and pruning has no lower limit",
        plan: |full| Some(FitPlan { floor: 0, ..paper(full) }),
        absent: "",
    },
    Variant {
        name: "paper's rule, no floor, no anchor",
        about: "the same from random positions",
        plan: |full| Some(FitPlan { start: FitStart::Scatter, floor: 0, ..paper(full) }),
        absent: "",
    },
    Variant {
        name: "no mirror",
        about: "the anchor's hidden side stays empty",
        plan: |full| full.mirrors.then(|| FitPlan { mirror: Mirror::Off, ..full.plan.clone() }),
        absent: "the full fit mirrors nothing; it does in clips of at most nine frames with --set anchor-cameras on one \
                 side, or with --set mirror=on",
    },
    Variant {
        name: "no plate",
        about: "--plate off: the background belongs to the field",
        plan: |full| {
            (full.plan.plate != PlatePlan::None).then(|| FitPlan {
                plate: PlatePlan::None,
                coarse: Coarse::NONE,
                ..full.plan.clone()
            })
        },
        absent: "the full fit has none: photographs have masks, or there are too few for plates, or --plate off",
    },
    Variant {
        name: "nothing learned of cameras",
        about: "--learn none: times, colours, lenses and poses are as the capture states them",
        plan: |full| {
            let plan = &full.plan;
            let none = FitPlan { learned: Learned::default(), learns_disagreement: false, ..plan.clone() };
            (plan.learned != none.learned || plan.asks_for_gains()).then_some(none)
        },
        absent: "the full fit learns nothing: the capture asks for nothing, --learn names nothing, and there is no plate \
                 whose cameras could disagree",
    },
    Variant {
        name: "with LPIPS",
        about: "the loss has its LPIPS term",
        plan: |full| full.lpips.clone().map(|lpips| FitPlan { lpips: Some(lpips), ..full.plan.clone() }),
        absent: "LPIPS takes --lpips-weights",
    },
];

/// The full fit by the paper's rule.
fn paper(full: &FullFit) -> FitPlan {
    FitPlan { rule: DensityRule::Paper, fragment_weight: 0.0, ..full.plan.clone() }
}

impl Variant {
    /// Name of its folder.
    pub fn folder(&self) -> String {
        self.name.replace(", ", "-").replace('\'', "").replace(' ', "-")
    }
}

#[cfg(test)]
mod tests {
    use std::collections::BTreeSet;

    use super::*;

    #[test]
    fn folders_have_names_of_their_own() {
        let folders: BTreeSet<String> =
            VARIANTS.iter().map(|variant| variant.folder().to_lowercase()).collect();
        assert_eq!(folders.len(), VARIANTS.len());
        assert!(folders.contains("papers-rule-no-floor-no-anchor"), "{folders:?}");
        let is_plain = |folder: &String| folder.chars().all(|c| c.is_ascii_alphanumeric() || c == '-');
        assert!(folders.iter().all(is_plain), "{folders:?}");
    }
}

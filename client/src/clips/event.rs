//! [`LoadEvent`]: what loading a clip reports, from the network up to the window.

use codec::Clip;

use super::progress::Progress;

/// A report about a clip that is being loaded. Sources produce the first three; the loader adds the rest.
#[derive(Debug)]
pub enum LoadEvent<C = Box<Clip>> {
    /// How much has arrived.
    Progress(Progress),
    /// A remark for the viewer.
    Note(String),
    /// A version of the clip that plays. Better ones may follow; the last one is the best.
    Clip(C),
}

//! [`find`]: a viewpoint of a clip by its name or number.

use codec::Viewpoint;
use program::Fault;

/// Index of the viewpoint named `name`, or else of the viewpoint whose index `name` is.
///
/// # Errors
/// [`Fault::Usage`] with the list of viewpoints.
pub fn find(viewpoints: &[Viewpoint], name: &str) -> Result<usize, Fault> {
    let named = viewpoints.iter().position(|viewpoint| viewpoint.name == name);
    let numbered = || name.parse().ok().filter(|&index| index < viewpoints.len());
    named.or_else(numbered).ok_or_else(|| {
        let list =
            viewpoints.iter().enumerate().map(|(i, viewpoint)| format!("\"{}\" ({i})", viewpoint.name));
        let list = list.collect::<Vec<_>>().join(", ");
        Fault::Usage(format!("there is no viewpoint \"{name}\": give one of {list}"))
    })
}

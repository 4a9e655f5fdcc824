//! One module per subcommand: its arguments and what it does.

pub(crate) mod apk;
pub(crate) mod bench;
pub(crate) mod ci;
pub(crate) mod demo;
pub(crate) mod dist;
pub(crate) mod headset;
pub(crate) mod notices;
pub(crate) mod picture;
pub(crate) mod test;

//! [`add_fallback`]: the fonts of the system, for names in scripts that egui's own fonts lack.

use std::sync::{Arc, LazyLock};

use egui_system_font_provider::SystemFontProvider;

/// Lets `ctx` use the fonts of the system. The first call lists them on a thread of its own.
pub(crate) fn add_fallback(ctx: &egui::Context) {
    static FONTS: LazyLock<Arc<SystemFontProvider>> = LazyLock::new(|| Arc::new(SystemFontProvider::new()));
    ctx.add_font_provider(FONTS.clone());
}

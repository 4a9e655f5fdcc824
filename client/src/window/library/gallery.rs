//! [`Gallery`]: a list over the picture with the clips to choose from, and thumbnails of those in sight.

use std::collections::HashMap;

use egui::{
    Align, Align2, Area, Color32, Context, CornerRadius, Id, Image, Layout, Order, Rect, Response, RichText,
    Role, ScrollArea, Sense, Stroke, StrokeKind, TextureHandle, TextureOptions, Ui, Vec2, WidgetInfo, pos2,
    vec2,
};

use super::choice::{ListedClip, Opening, Section};
use super::thumbnails::{self, Picture};
use crate::clips::redacted;
use crate::window::icons::{Symbol, symbol_button};
use crate::window::style;

/// Size of a picture, and height of the title under it, in points.
const PICTURE: Vec2 = vec2(192.0, 108.0);
const TITLE_HEIGHT: f32 = 22.0;

/// Space between tiles, around the gallery and between it and the bar below, in points.
const SPACE: f32 = 10.0;
const MARGIN: f32 = 28.0;

/// Most pictures in GPU memory besides those in sight.
const PICTURES: usize = 256;

/// The list of clips.
#[derive(Default)]
pub(crate) struct Gallery {
    is_open: bool,
    sections: Vec<Section>,
    /// The clip on display.
    current: Option<String>,
    pictures: HashMap<String, Thumbnail>,
    /// Clips in sight without a picture; `None` if they were asked for.
    wanted: Option<Vec<String>>,
    /// Clips in sight, whose pictures are there or were asked for.
    visible: Vec<String>,
}

/// The picture of a clip.
enum Thumbnail {
    Shown(TextureHandle),
    /// Why there is none, if there is something to say.
    Missing(String),
}

impl Gallery {
    pub(crate) fn is_open(&self) -> bool {
        self.is_open
    }

    /// Opens it with these clips.
    pub(super) fn open(&mut self, sections: Vec<Section>, current: Option<String>) {
        self.sections = sections;
        self.current = current;
        // A clip may have another picture by now.
        self.pictures.clear();
        self.visible.clear();
        self.is_open = true;
    }

    /// Marks the clip on display.
    pub(super) fn mark(&mut self, current: Option<String>) {
        self.current = current;
    }

    pub(crate) fn close(&mut self) {
        self.is_open = false;
        self.wanted = None;
    }

    /// Takes in the picture of a clip.
    pub(super) fn set_picture(&mut self, ctx: &Context, name: String, picture: Picture) {
        let thumbnail = match picture {
            Ok(image) => Thumbnail::Shown(ctx.load_texture(&name, image, TextureOptions::LINEAR)),
            Err(why) => Thumbnail::Missing(why),
        };
        if self.pictures.len() > PICTURES {
            let Gallery { pictures, visible, .. } = self;
            pictures.retain(|name, _| visible.contains(name));
        }
        self.pictures.insert(name, thumbnail);
        ctx.request_repaint();
    }

    /// Clips whose pictures are to be made, if they are others than before.
    pub(super) fn take_wanted(&mut self) -> Option<Vec<String>> {
        self.wanted.take()
    }

    /// Shows the list above the bar, `bar_height` points high. Returns what was chosen.
    pub(crate) fn show(&mut self, ctx: &Context, bar_height: f32) -> Option<Opening> {
        if !self.is_open {
            return None;
        }
        let screen = ctx.content_rect();
        let size = screen.size() - vec2(2.0 * MARGIN, 2.0 * MARGIN + bar_height);
        let mut choice = None;
        let area = Area::new(Id::unique("gallery")).order(Order::Middle);
        area.anchor(Align2::LEFT_TOP, Vec2::splat(MARGIN)).show(ctx, |ui| {
            style::card().show(ui, |ui| {
                // The card has margins of its own.
                let inner = (size - vec2(24.0, 20.0)).max(PICTURE);
                ui.set_min_size(inner);
                ui.set_max_size(inner);
                choice = self.header(ui);
                ScrollArea::vertical().auto_shrink(false).show(ui, |ui| {
                    choice = self.sections(ui).or(choice.take());
                });
            });
        });
        if choice.is_some() {
            self.close();
        }
        choice
    }

    fn header(&mut self, ui: &mut Ui) -> Option<Opening> {
        let mut choice = None;
        ui.horizontal(|ui| {
            ui.label(RichText::new("Clips").strong().size(16.0));
            ui.with_layout(Layout::right_to_left(Align::Center), |ui| {
                if symbol_button(ui, Symbol::Close, "Close (Esc)").clicked() {
                    self.close();
                }
                if ui.button("Open a file").on_hover_text("Choose a file (O)").clicked() {
                    choice = Some(Opening::Picker);
                }
            });
        });
        choice
    }

    /// Shows the clips, and notes those in sight.
    fn sections(&mut self, ui: &mut Ui) -> Option<Opening> {
        if self.sections.iter().all(|section| section.clips.is_empty()) {
            ui.label(
                RichText::new("There is no clip here: open a file, or drop one on the window")
                    .color(style::QUIET),
            );
        }
        let (mut choice, mut visible) = (None, Vec::new());
        for section in self.sections.iter().filter(|section| !section.clips.is_empty()) {
            ui.add_space(4.0);
            ui.label(RichText::new(&section.title).color(style::QUIET));
            ui.horizontal_wrapped(|ui| {
                ui.spacing_mut().item_spacing = Vec2::splat(SPACE);
                for clip in &section.clips {
                    let (name, response) = (&clip.name, self.tile(ui, clip));
                    if ui.is_rect_visible(response.rect) && !visible.contains(name) {
                        visible.push(name.clone());
                    }
                    if response.clicked() {
                        choice = Some(Opening::Clip(name.clone()));
                    }
                }
            });
        }
        if visible != self.visible {
            let wanted = visible.iter().filter(|name| !self.pictures.contains_key(*name));
            self.wanted = Some(wanted.cloned().collect());
            self.visible = visible;
        }
        choice
    }

    /// A picture with a title, as a button.
    fn tile(&self, ui: &mut Ui, ListedClip { name, title }: &ListedClip) -> Response {
        let (rect, response) = ui.allocate_exact_size(PICTURE + vec2(0.0, TITLE_HEIGHT), Sense::click());
        response.widget_info(|| WidgetInfo::labeled(Role::Button, ui.is_enabled(), title));
        if !ui.is_rect_visible(rect) {
            return response;
        }
        let picture = Rect::from_min_size(rect.min, PICTURE);
        let corners = CornerRadius::same(5);
        let mut hint = redacted(name);
        ui.painter().rect_filled(picture, corners, Color32::from_gray(34));
        match self.pictures.get(name) {
            Some(Thumbnail::Shown(texture)) => {
                Image::from_texture(texture).corner_radius(corners).paint_at(ui, picture);
            }
            Some(Thumbnail::Missing(why)) => {
                text(ui, picture, "no picture", style::QUIET);
                if !why.is_empty() {
                    hint = format!("{hint}\n{why}");
                }
            }
            None => text(ui, picture, "...", style::QUIET),
        }
        let is_current = self.current.as_ref() == Some(name);
        let stroke = match (is_current, response.hovered() || response.has_focus()) {
            (_, true) => Stroke::new(2.0, Color32::WHITE),
            (true, false) => Stroke::new(2.0, style::ACCENT),
            (false, false) => Stroke::NONE,
        };
        ui.painter().rect_stroke(picture, corners, stroke, StrokeKind::Inside);
        let below = Rect::from_min_max(pos2(rect.left(), picture.bottom()), rect.max);
        text(ui, below, title, if is_current { style::ACCENT } else { ui.visuals().text_color() });
        response.on_hover_text(hint)
    }
}

/// Writes a line in the middle of a rectangle.
fn text(ui: &Ui, rect: Rect, line: &str, color: Color32) {
    let painter = ui.painter().with_clip_rect(rect.intersect(ui.clip_rect()));
    painter.text(rect.center(), Align2::CENTER_CENTER, line, egui::FontId::proportional(12.5), color);
}

/// Pictures have the shape of their place.
const _: () = assert!(thumbnails::SIZE[0] * 108 == thumbnails::SIZE[1] * 192);

#[cfg(test)]
mod tests {
    use egui::{ColorImage, Event, Modifiers, PointerButton, Pos2, RawInput};

    use super::super::choice::listed;
    use super::*;

    const SCREEN: Vec2 = vec2(900.0, 600.0);

    struct Bench {
        ctx: Context,
        gallery: Gallery,
    }

    impl Bench {
        fn with(names: &[&str]) -> Bench {
            let mut gallery = Gallery::default();
            let clips = listed(names.iter().map(|name| (*name).to_owned()).collect());
            gallery.open(vec![Section { title: "Here".into(), clips }], Some("/a.aarc".into()));
            let mut bench = Bench { ctx: Context::default(), gallery };
            style::apply(&bench.ctx);
            bench.frame(vec![]);
            bench.frame(vec![]);
            bench
        }

        fn frame(&mut self, events: Vec<Event>) -> Option<Opening> {
            let screen_rect = Some(Rect::from_min_size(Pos2::ZERO, SCREEN));
            let input = RawInput { screen_rect, focused: true, events, ..RawInput::default() };
            let mut choice = None;
            let gallery = &mut self.gallery;
            self.ctx.run_ui(input, |ui| choice = gallery.show(ui.ctx(), 80.0)).drop_without_applying_deltas();
            choice
        }

        fn click(&mut self, pos: Pos2) -> Option<Opening> {
            let event = |pressed| Event::PointerButton {
                pos,
                button: PointerButton::Primary,
                pressed,
                modifiers: Modifiers::NONE,
            };
            self.frame(vec![Event::PointerMoved(pos)]);
            self.frame(vec![event(true), event(false)])
        }
    }

    /// In the first tile.
    const FIRST: Pos2 = pos2(100.0, 160.0);

    #[test]
    fn a_click_on_a_picture_chooses_its_clip_and_closes_the_gallery() {
        let mut bench = Bench::with(&["/a.aarc", "/b.aarc"]);
        assert_eq!(bench.click(FIRST), Some(Opening::Clip("/a.aarc".into())));
        assert!(!bench.gallery.is_open());
        assert_eq!(bench.click(FIRST), None, "it is closed");
        let mut bench = Bench::with(&["/a.aarc", "/b.aarc"]);
        assert_eq!(bench.click(FIRST + vec2(PICTURE.x + SPACE, 0.0)), Some(Opening::Clip("/b.aarc".into())));
    }

    #[test]
    fn only_pictures_visible_are_asked_for_and_once() {
        let names: Vec<String> = (0..400).map(|i| format!("/{i:03}.aarc")).collect();
        let mut bench = Bench::with(&names.iter().map(String::as_str).collect::<Vec<_>>());
        let wanted = bench.gallery.take_wanted().unwrap();
        assert!((4..40).contains(&wanted.len()) && wanted[0] == names[0], "{wanted:?}");
        bench.frame(vec![]);
        assert_eq!(bench.gallery.take_wanted(), None);
        let image = || ColorImage::filled([320, 180], Color32::WHITE);
        for name in &names {
            bench.gallery.set_picture(&bench.ctx, name.clone(), Ok(image()));
        }
        assert!(bench.gallery.pictures.len() <= PICTURES + 1, "GPU memory is bounded");
        bench.gallery.set_picture(&bench.ctx, "/000.aarc".into(), Err("damaged".into()));
        assert!(matches!(&bench.gallery.pictures["/000.aarc"], Thumbnail::Missing(why) if why == "damaged"));
        bench.frame(vec![]);
    }

    #[test]
    fn an_empty_gallery_says_so_and_closes() {
        let mut bench = Bench::with(&[]);
        assert!(bench.gallery.is_open());
        bench.gallery.close();
        assert_eq!(bench.frame(vec![]), None);
    }
}

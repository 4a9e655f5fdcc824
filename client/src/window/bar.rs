//! The bar at the bottom: timeline, transport and menus. A static clip has menus alone.

use std::sync::Arc;

use codec::Viewpoint;
use egui::containers::menu::{MenuButton, MenuConfig};
use egui::{
    Align, Frame, Layout, Margin, Panel, PopupCloseBehavior, Rect, Response, RichText, ScrollArea, Sense,
    Slider, TextStyle, Ui, vec2,
};

use super::icons::{Symbol, symbol_button};
use super::keys::Command;
use super::library::{ListedClip, Opening};
use super::style;
use crate::audio::Volume;
use crate::clock::{Clock, SPEEDS};
use crate::content::redacted;
use crate::gpu::{Cutoff, RenderSettings, SortOrder};

/// What can be opened and changed besides the clip on display.
#[derive(Clone, Debug, Default, PartialEq, Eq)]
pub(crate) struct Choices {
    pub(crate) has_previous: bool,
    pub(crate) has_next: bool,
    /// Whether the clip is a package on disk, which can have another poster.
    pub(crate) is_package: bool,
    /// What was opened last, the last one first.
    pub(crate) recent: Arc<[ListedClip]>,
}

/// The state that the bar shows and changes.
pub(crate) struct Controls<'a> {
    pub(crate) clock: &'a mut Clock,
    pub(crate) settings: &'a mut RenderSettings,
    pub(crate) choices: &'a Choices,
    /// Clips chosen in menus.
    pub(crate) opening: &'a mut Vec<Opening>,
    /// Whether the pointer holds the timeline.
    pub(crate) is_scrubbing: &'a mut bool,
    /// Whether the clip has no timeline.
    pub(crate) is_static: bool,
    /// How loud the sound is, if there is some.
    pub(crate) volume: Option<&'a mut Volume>,
    /// Why it is not heard, if there is no audio device.
    pub(crate) silence: Option<&'a str>,
    /// Parts of a take that play without loading, as seconds (from, to).
    pub(crate) buffered: &'a [(f64, f64)],
    /// Number of layers of the clip.
    pub(crate) layers: usize,
    pub(crate) viewpoints: &'a [Viewpoint],
    /// Index of the viewpoint chosen last.
    pub(crate) viewpoint: usize,
}

/// Shows the bar. Appends the commands of its buttons to `commands`.
pub(crate) fn show(ui: &mut Ui, mut controls: Controls<'_>, commands: &mut Vec<Command>) {
    let frame = Frame::new().fill(ui.visuals().panel_fill).inner_margin(Margin {
        left: 14,
        right: 14,
        top: 8,
        bottom: 8,
    });
    Panel::bottom("bar").frame(frame).resizable(false).show_separator_line(false).show(ui, |ui| {
        *controls.is_scrubbing = !controls.is_static && timeline(ui, controls.clock, controls.buffered);
        ui.horizontal(|ui| {
            ui.spacing_mut().item_spacing.x = 2.0;
            neighbours(ui, controls.choices, commands);
            if !controls.is_static {
                transport(ui, controls.clock, commands);
                if let Some(volume) = controls.volume.take() {
                    let plain = controls.clock.speed() == 1.0 && !controls.clock.is_reversed();
                    let otherwise = (!plain).then_some("Sound is heard forward at normal speed");
                    sound(ui, volume, controls.silence.or(otherwise), commands);
                }
            }
            ui.with_layout(Layout::right_to_left(Align::Center), |ui| menus(ui, controls, commands));
        });
    });
}

/// Height of the marks of what is buffered, in points.
const BUFFERED_HEIGHT: f32 = 2.0;

/// Shows the slider over the clip, and below it what is `buffered`; returns whether the pointer holds it.
fn timeline(ui: &mut Ui, clock: &mut Clock, buffered: &[(f64, f64)]) -> bool {
    let mut position_s = clock.position_s();
    let has_duration = clock.duration_s() > 0.0;
    let slider = Slider::new(&mut position_s, 0.0..=clock.duration_s().max(f64::MIN_POSITIVE))
        .show_value(false)
        .smart_aim(false);
    ui.spacing_mut().slider_width = ui.available_width();
    let response = ui.add_enabled_ui(has_duration, |ui| clickable(ui, slider)).inner;
    if response.changed() {
        clock.seek(position_s);
    }
    let (track, y) = (response.rect, response.rect.bottom());
    let x = |seconds: f64| track.left() + track.width() * (seconds / clock.duration_s()) as f32;
    for &(from_s, to_s) in buffered.iter().filter(|_| has_duration) {
        let mark = Rect::from_x_y_ranges(x(from_s)..=x(to_s), y - BUFFERED_HEIGHT..=y);
        ui.painter().rect_filled(mark, 0.0, style::ACCENT.gamma_multiply(0.6));
    }
    response.is_pointer_button_down_on()
}

/// Shows a slider that also follows a press and release within one frame, which is a click and no drag.
fn clickable(ui: &mut Ui, slider: Slider<'_>) -> Response {
    let response = ui.add(slider);
    response.interact(Sense::click()) | response
}

/// The buttons of the clips before and after, if there are some.
fn neighbours(ui: &mut Ui, choices: &Choices, commands: &mut Vec<Command>) {
    if !choices.has_previous && !choices.has_next {
        return;
    }
    for (symbol, hint, command) in [
        (Symbol::PreviousClip, "Previous clip (Page Up)", Command::PreviousClip),
        (Symbol::NextClip, "Next clip (Page Down)", Command::NextClip),
    ] {
        if symbol_button(ui, symbol, hint).clicked() {
            commands.push(command);
        }
    }
    ui.add_space(6.0);
}

fn transport(ui: &mut Ui, clock: &Clock, commands: &mut Vec<Command>) {
    let (play, hint) = match clock.is_playing() {
        true => (Symbol::Pause, "Pause (Space)"),
        false => (Symbol::Play, "Play (Space)"),
    };
    let buttons = [
        (Symbol::StepBack, "One frame back (Left)", Command::StepBack),
        (play, hint, Command::TogglePlaying),
        (Symbol::StepForward, "One frame on (Right)", Command::StepForward),
    ];
    for (symbol, hint, command) in buttons {
        if symbol_button(ui, symbol, hint).clicked() {
            commands.push(command);
        }
    }
    ui.add_space(10.0);
    time(ui, clock);
    if ui.available_width() > MENUS_WIDTH + FRAMES_WIDTH {
        ui.add_space(8.0);
        let frames = format!("frame {} / {}", clock.frame(), clock.last_frame());
        ui.label(RichText::new(frames).monospace().color(style::QUIET));
    }
}

/// Shows the position, and the duration where it leaves room for the rest.
fn time(ui: &mut Ui, clock: &Clock) {
    let [position, duration] = time_texts(clock);
    let font = TextStyle::Monospace.resolve(ui.style());
    let both = format!("{position} / {duration}");
    let galley = ui.painter().layout_no_wrap(both, font.clone(), ui.visuals().text_color());
    if ui.available_width() > galley.size().x + MUTE_WIDTH + MENUS_WIDTH {
        ui.label(galley);
    } else {
        ui.label(RichText::new(position).font(font));
    }
}

/// Width of the menus, and most that the count of frames takes, in points. A narrow bar leaves out the count, then the
/// slider of the volume, and then the duration.
const MENUS_WIDTH: f32 = 410.0;
const FRAMES_WIDTH: f32 = 190.0;

/// Width of the button that mutes, with the space before it, in points.
const MUTE_WIDTH: f32 = 37.0;

/// Width of the slider of the volume, in points.
const VOLUME_WIDTH: f32 = 80.0;

/// Shows whether sound is muted, and how loud it is, or by `silence` why it is not heard.
fn sound(ui: &mut Ui, volume: &mut Volume, silence: Option<&str>, commands: &mut Vec<Command>) {
    ui.add_space(10.0);
    let (symbol, hint) = match volume.is_muted() {
        true => (Symbol::Muted, "Sound on (M)"),
        false => (Symbol::Sound, "Mute (M)"),
    };
    if symbol_button(ui, symbol, hint).clicked() {
        commands.push(Command::ToggleMuted);
    }
    if ui.available_width() < MENUS_WIDTH + VOLUME_WIDTH {
        return;
    }
    let mut level = if volume.is_muted() { 0.0 } else { volume.level() };
    ui.spacing_mut().slider_width = VOLUME_WIDTH;
    let slider = Slider::new(&mut level, 0.0..=1.0).show_value(false);
    let slider = ui.add_enabled_ui(silence.is_none(), |ui| clickable(ui, slider)).inner;
    if slider.on_hover_text("Volume").on_disabled_hover_text(silence.unwrap_or_default()).changed() {
        volume.set_level(level);
    }
}

/// Position and duration to hundredths of a second: `1.25`, `10.00 s`; ` 0:59.20`, `11:30.00`. The position is as wide
/// everywhere in the clip.
fn time_texts(clock: &Clock) -> [String; 2] {
    let (position_s, duration_s) = (clock.position_s(), clock.duration_s());
    if duration_s < 60.0 {
        return [format!("{position_s:5.2}"), format!("{duration_s:.2} s")];
    }
    let minutes = |seconds: f64| {
        let hundredths = (seconds * 100.0).round() as u64;
        format!("{}:{:02}.{:02}", hundredths / 6000, hundredths / 100 % 60, hundredths % 100)
    };
    let duration = minutes(duration_s);
    [format!("{:>1$}", minutes(position_s), duration.len()), duration]
}

/// The menus, laid out from right to left.
fn menus(ui: &mut Ui, controls: Controls<'_>, commands: &mut Vec<Command>) {
    ui.spacing_mut().item_spacing = vec2(6.0, 4.0);
    if ui.button("Keys").on_hover_text("List of keys (H)").clicked() {
        commands.push(Command::ToggleKeys);
    }
    if ui.button("Snapshot").on_hover_text("Save a picture (P)").clicked() {
        commands.push(Command::Screenshot);
    }
    rendering_menu(ui, controls.settings, controls.layers);
    ui.menu_button("View", |ui| view_menu(ui, &controls, commands));
    ui.menu_button("Clips", |ui| clips_menu(ui, controls.choices, controls.opening, commands));
    if !controls.is_static {
        playing_menus(ui, controls.clock, commands);
    }
}

/// Loop, speed and direction.
fn playing_menus(ui: &mut Ui, clock: &mut Clock, commands: &mut Vec<Command>) {
    let looping = clock.is_looping();
    if ui.selectable_label(looping, "Loop").on_hover_text("Start over at the end (L)").clicked() {
        commands.push(Command::ToggleLoop);
    }
    let speed = clock.speed();
    let sign = if clock.is_reversed() { "-" } else { "" };
    ui.menu_button(format!("{sign}{}", speed_text(speed)), |ui| {
        for choice in SPEEDS.into_iter().rev() {
            if ui.selectable_label(speed == choice, speed_text(choice)).clicked() {
                clock.set_speed(choice);
                ui.close();
            }
        }
        ui.separator();
        if ui.selectable_label(clock.is_reversed(), "Backwards (B)").clicked() {
            commands.push(Command::ToggleReverse);
            ui.close();
        }
    })
    .response
    .on_hover_text("Speed (Up, Down), direction (B)");
}

fn speed_text(speed: f64) -> String {
    format!("{speed}x")
}

fn clips_menu(ui: &mut Ui, choices: &Choices, opening: &mut Vec<Opening>, commands: &mut Vec<Command>) {
    begin_menu(ui, 220.0);
    for (name, key, command, is_enabled) in [
        ("Open a file", "O", Command::OpenFile, true),
        ("Previous", "Page Up", Command::PreviousClip, choices.has_previous),
        ("Next", "Page Down", Command::NextClip, choices.has_next),
    ] {
        if ui.add_enabled(is_enabled, egui::Button::new(name).shortcut_text(key)).clicked() {
            commands.push(command);
        }
    }
    ui.separator();
    let poster = ui.add_enabled(choices.is_package, egui::Button::new("Use this frame as the poster"));
    let poster = poster.on_hover_text("File managers show it. Changes the file of the clip.");
    let poster =
        poster.on_disabled_hover_text("Only a clip in a file of this machine has a poster to change.");
    if poster.clicked() {
        commands.push(Command::SetPoster);
    }
    if choices.recent.is_empty() {
        return;
    }
    ui.separator();
    ui.label(RichText::new("Opened last").color(style::QUIET));
    scrolled(ui, 233.0, |ui| {
        for ListedClip { name, title } in choices.recent.iter() {
            if ui.button(title).on_hover_text(redacted(name)).clicked() {
                opening.push(Opening::Clip(name.clone()));
            }
        }
    });
}

/// Begins a menu with a list, at least `width` points wide.
fn begin_menu(ui: &mut Ui, width: f32) {
    ui.set_min_width(width);
    // Else it would be at most 400 points high, the default of areas.
    ui.set_max_height(ui.ctx().content_rect().height());
}

/// Shows entries of a menu, which scroll if the window is too low. Its other entries and the bar take `rest` points.
fn scrolled(ui: &mut Ui, rest: f32, contents: impl FnOnce(&mut Ui)) {
    let height = (ui.ctx().content_rect().height() - rest).max(60.0);
    ScrollArea::vertical().max_height(height).show(ui, contents);
}

fn view_menu(ui: &mut Ui, controls: &Controls<'_>, commands: &mut Vec<Command>) {
    begin_menu(ui, 180.0);
    scrolled(ui, 175.0, |ui| {
        for (number, viewpoint) in controls.viewpoints.iter().enumerate() {
            let key = if number < 9 { format!("{}", number + 1) } else { String::new() };
            let chosen = number == controls.viewpoint;
            let entry = egui::Button::selectable(chosen, viewpoint.name.as_str()).shortcut_text(key);
            if ui.add(entry).clicked() {
                commands.push(Command::GoToViewpoint(number));
            }
        }
    });
    ui.separator();
    for (name, key, command) in [
        ("Recentre", "R", Command::Recentre),
        ("Full screen", "F", Command::ToggleFullScreen),
        ("Hide controls", "U", Command::ToggleInterface),
    ] {
        if ui.add(egui::Button::new(name).shortcut_text(key)).clicked() {
            commands.push(command);
        }
    }
}

/// The render settings. The menu stays open to compare choices.
fn rendering_menu(ui: &mut Ui, settings: &mut RenderSettings, layers: usize) {
    let stay_open = MenuConfig::new().close_behavior(PopupCloseBehavior::CloseOnClickOutside);
    MenuButton::new("Rendering").config(stay_open).ui(ui, |ui| {
        ui.label(RichText::new("Sort by").color(style::QUIET));
        ui.radio_value(&mut settings.sort, SortOrder::Depth, "Depth")
            .on_hover_text("Along the view axis, as clips are fitted");
        ui.radio_value(&mut settings.sort, SortOrder::Radial, "Distance")
            .on_hover_text("From the eye: steady while the view turns");
        ui.separator();
        ui.label(RichText::new("Cut Gaussians off").color(style::QUIET));
        ui.radio_value(&mut settings.cutoff, Cutoff::Exact, "Where they fade out");
        ui.radio_value(&mut settings.cutoff, Cutoff::Sqrt8, "At 2.83 sigma");
        ui.radio_value(&mut settings.cutoff, Cutoff::Sqrt5, "At 2.24 sigma");
        if layers > 1 {
            ui.separator();
            ui.label(RichText::new("Layers").color(style::QUIET));
            let mut drawn = settings.layers.unwrap_or(layers).min(layers);
            if clickable(ui, Slider::new(&mut drawn, 1..=layers)).changed() {
                settings.layers = (drawn < layers).then_some(drawn);
            }
        }
    });
}

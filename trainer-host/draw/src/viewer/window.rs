//! The window.

use std::num::NonZeroU32;
use std::sync::Arc;
use std::time::{Duration, Instant};

use softbuffer::{Context, Surface};
use winit::application::ApplicationHandler;
use winit::dpi::PhysicalSize;
use winit::event::{ElementState, MouseButton, MouseScrollDelta, WindowEvent};
use winit::event_loop::{ActiveEventLoop, ControlFlow, EventLoop, OwnedDisplayHandle};
use winit::keyboard::Key;
use winit::window::{Window, WindowId};

use super::{Controls, Flow, LEAST_SIZE, Spectacle, action};
use crate::video::VideoError;

/// Time between two pictures while the flight goes on.
const PACE: Duration = Duration::from_millis(16);

/// Pixels of a touch pad that are a notch of a wheel.
const PIXELS_PER_NOTCH: f64 = 40.0;

/// Why there is no window, or no longer.
#[derive(Debug, thiserror::Error)]
pub enum WindowError {
    /// No screen, or a system that refuses.
    #[error("cannot open a window ({0}): use a desktop, or write a file with --headless FILE.gif")]
    Refused(String),
    /// There is no picture to show.
    #[error(transparent)]
    Video(#[from] VideoError),
}

/// A screen, on which windows can be opened.
#[derive(Debug)]
pub struct Desktop(Box<EventLoop<()>>);

impl Desktop {
    /// Once in a program, and on its main thread.
    ///
    /// # Errors
    /// When there is no screen.
    pub fn open() -> Result<Self, WindowError> {
        EventLoop::new().map(|events| Self(Box::new(events))).map_err(refused)
    }

    /// Shows something in a window of so many pixels until the user has seen enough, or it is over.
    ///
    /// # Errors
    /// When the system refuses, or the renderer fails.
    pub fn show(
        self,
        spectacle: &mut dyn Spectacle,
        controls: Controls,
        title: &str,
        size: [usize; 2],
    ) -> Result<(), WindowError> {
        let title = title.to_owned();
        let mut viewer =
            Viewer { spectacle, controls, title, size, open: None, then: None, dragged: None, failed: None };
        self.0.run_app(&mut viewer).map_err(refused)?;
        viewer.failed.map_or(Ok(()), Err)
    }
}

/// For `map_err`, which gives what it has.
#[expect(clippy::needless_pass_by_value, reason = "errors are handed over whole")]
fn refused(error: impl ToString) -> WindowError {
    let words = error.to_string();
    // The system's reason, without the line of winit that met it.
    let reason = words.strip_prefix("os error at ").and_then(|rest| rest.split_once(": "));
    WindowError::Refused(reason.map_or(&words[..], |(_, reason)| reason).trim_end_matches('.').to_owned())
}

struct Viewer<'a> {
    spectacle: &'a mut dyn Spectacle,
    controls: Controls,
    title: String,
    size: [usize; 2],
    open: Option<Open>,
    /// When time was last seen to pass.
    then: Option<Instant>,
    /// Where the mouse was while its button is held \[px\].
    dragged: Option<Drag>,
    failed: Option<WindowError>,
}

struct Open {
    window: Arc<Window>,
    surface: Surface<OwnedDisplayHandle, Arc<Window>>,
}

/// A held button: where the mouse was last seen, once it was.
#[derive(Clone, Copy, Debug)]
struct Drag(Option<[f64; 2]>);

impl ApplicationHandler for Viewer<'_> {
    fn resumed(&mut self, events: &ActiveEventLoop) {
        match self.opened(events) {
            Ok(open) => self.open = Some(open),
            Err(error) => self.fail(events, error),
        }
    }

    #[expect(clippy::wildcard_enum_match_arm, reason = "a window hears of much that is not for it")]
    fn window_event(&mut self, events: &ActiveEventLoop, _window: WindowId, event: WindowEvent) {
        match event {
            WindowEvent::CloseRequested => events.exit(),
            WindowEvent::RedrawRequested => {
                if let Err(error) = self.draw() {
                    self.fail(events, error);
                }
                return;
            }
            WindowEvent::KeyboardInput { event, .. } if event.state == ElementState::Pressed => {
                let asked = action(&name(&event.logical_key));
                let extent = self.spectacle.extent();
                if asked.map(|asked| self.controls.apply(asked, &extent)) == Some(Flow::Quit) {
                    events.exit();
                }
            }
            WindowEvent::MouseInput { state, button: MouseButton::Left, .. } => {
                self.dragged = (state == ElementState::Pressed).then_some(Drag(None));
            }
            WindowEvent::CursorMoved { position, .. } => self.point([position.x, position.y]),
            WindowEvent::MouseWheel { delta, .. } => self.controls.zoom(match delta {
                MouseScrollDelta::LineDelta(_, lines) => f64::from(lines),
                MouseScrollDelta::PixelDelta(pixels) => pixels.y / PIXELS_PER_NOTCH,
            }),
            _ => {}
        }
        self.redraw();
    }

    fn about_to_wait(&mut self, events: &ActiveEventLoop) {
        let now = Instant::now();
        let passed = self.then.map_or(Duration::ZERO, |then| now - then);
        match self.spectacle.follow(&mut self.controls) {
            Ok(Flow::Continue) => {}
            Ok(Flow::Quit) => events.exit(),
            Err(error) => self.fail(events, error.into()),
        }
        if !self.controls.playing {
            self.then = None;
            events.set_control_flow(ControlFlow::Wait);
        } else if self.then.is_none() || passed >= PACE {
            let extent = self.spectacle.extent();
            self.controls.advance(passed.as_secs_f32(), &extent);
            self.then = Some(now);
            events.set_control_flow(ControlFlow::WaitUntil(now + PACE));
            self.redraw();
        }
    }
}

impl Viewer<'_> {
    fn opened(&self, events: &ActiveEventLoop) -> Result<Open, WindowError> {
        let [width, height] = self.size.map(|pixels| pixels as u32);
        let [least_width, least_height] = LEAST_SIZE.map(|pixels| pixels as u32);
        let attributes = Window::default_attributes()
            .with_title(&self.title)
            .with_inner_size(PhysicalSize::new(width, height))
            .with_min_inner_size(PhysicalSize::new(least_width, least_height));
        let window = Arc::new(events.create_window(attributes).map_err(refused)?);
        let context = Context::new(events.owned_display_handle()).map_err(refused)?;
        let surface = Surface::new(&context, Arc::clone(&window)).map_err(refused)?;
        Ok(Open { window, surface })
    }

    fn draw(&mut self) -> Result<(), WindowError> {
        let Some(Open { window, surface }) = &mut self.open else { return Ok(()) };
        let size = window.inner_size();
        let (Some(width), Some(height)) = (NonZeroU32::new(size.width), NonZeroU32::new(size.height)) else {
            return Ok(());
        };
        self.spectacle.resize([size.width, size.height].map(|pixels| pixels as usize));
        let picture = self.spectacle.picture(&self.controls)?;
        surface.resize(width, height).map_err(refused)?;
        let mut buffer = surface.buffer_mut().map_err(refused)?;
        let rows = buffer.chunks_exact_mut(size.width as usize);
        for (line, pixels) in rows.zip(picture.pixels.chunks_exact(picture.size[0])) {
            for (shown, [red, green, blue]) in line.iter_mut().zip(pixels) {
                *shown = u32::from_be_bytes([0, *red, *green, *blue]);
            }
        }
        buffer.present().map_err(refused)
    }

    /// The mouse is somewhere.
    fn point(&mut self, [x, y]: [f64; 2]) {
        if let Some(Drag(last)) = &mut self.dragged {
            let [from_x, from_y] = last.replace([x, y]).unwrap_or([x, y]);
            self.controls.drag([x - from_x, y - from_y]);
        }
    }

    fn redraw(&self) {
        if let Some(open) = &self.open {
            open.window.request_redraw();
        }
    }

    fn fail(&mut self, events: &ActiveEventLoop, error: WindowError) {
        self.failed = Some(error);
        events.exit();
    }
}

/// As [`action`] calls a key.
fn name(key: &Key) -> String {
    match key {
        Key::Character(letter) => letter.to_lowercase(),
        Key::Named(named) => format!("{named:?}"),
        Key::Unidentified(_) | Key::Dead(_) => String::new(),
    }
}

#[cfg(test)]
mod tests {
    use winit::keyboard::NamedKey;

    use super::*;
    use crate::viewer::Action;

    #[test]
    fn a_refusal_is_the_systems_reason() {
        let said = |words: &str| refused(words).to_string();
        let expected = "cannot open a window (no screen): use a desktop, or write a file with --headless FILE.gif";
        assert_eq!(said("os error at /some/where/mod.rs:765: no screen."), expected);
        assert_eq!(said("no screen"), expected);
    }

    #[test]
    fn keys_of_the_window_have_the_names_of_the_controls() {
        let of = |key: Key| action(&name(&key));
        assert_eq!(of(Key::Named(NamedKey::ArrowRight)), Some(Action::Step(1)));
        assert_eq!(of(Key::Named(NamedKey::Space)), Some(Action::Pause));
        assert_eq!(of(Key::Named(NamedKey::Escape)), Some(Action::Quit));
        assert_eq!(of(Key::Character("Q".into())), Some(Action::Quit));
        assert_eq!(of(Key::Dead(None)), None);
    }
}

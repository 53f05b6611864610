//! Who looks at flights while they are flown: somebody before a window, if the program was built with them, or a film.

use std::panic::resume_unwind;
use std::path::Path;
use std::sync::mpsc::{Receiver, Sender, channel};
use std::thread;

use anyhow::{Result, bail};
use kestrel_draw::video::VideoFormat;
#[cfg(not(feature = "viewer"))]
use kestrel_draw::viewer::Spectacle;
#[cfg(feature = "viewer")]
pub(crate) use kestrel_draw::viewer::window::Desktop;
use kestrel_draw::viewer::{Controls, Glimpse, LiveViewport};
use kestrel_experiments::atomic_file::{check_writable, write_atomically};
use kestrel_experiments::output::say;
use kestrel_sim::camera::Backend;

use crate::command::look::filmed;
use crate::renderer;

/// Columns and rows of windows and films \[px\].
const SIZE: [usize; 2] = [960, 540];

/// There is none: this program was built without windows.
#[cfg(not(feature = "viewer"))]
#[derive(Debug)]
pub(crate) enum Desktop {}

#[cfg(not(feature = "viewer"))]
impl Desktop {
    /// # Errors
    /// Always.
    pub(crate) fn open() -> Result<Self> {
        bail!(
            "this program was built without windows: build it with `--features viewer`, or use --headless FILE.gif"
        )
    }

    /// # Errors
    /// Never: there is nothing to show it.
    pub(crate) fn show(self, _: &mut dyn Spectacle, _: Controls, _: &str, _: [usize; 2]) -> Result<()> {
        match self {}
    }
}

/// Does `work` in another thread, while a window shows what it tells. When the user closes the window, `closed` is called.
///
/// # Errors
/// What could not be shown.
pub(crate) fn before_window<T: Send>(
    desktop: Desktop,
    title: &str,
    closed: &(dyn Fn() + Sync),
    work: impl FnOnce(Sender<Glimpse>) -> T + Send,
) -> Result<T> {
    let renderer = renderer::open(Backend::Auto)?;
    beside(work, |glimpses| {
        let live = LiveViewport::awaited(glimpses, &*renderer, SIZE)?;
        if let Some(mut live) = live {
            let shown = desktop.show(&mut live, Controls::default(), title, SIZE);
            closed();
            shown?;
        }
        Ok(())
    })
}

/// Does `work` in another thread, and writes a film of what it tells.
///
/// # Errors
/// Before the work begins: no such file. After it: what could not be shown or written.
pub(crate) fn filming<T: Send>(path: &Path, work: impl FnOnce(Sender<Glimpse>) -> T + Send) -> Result<T> {
    let Some(format) = VideoFormat::of(path) else {
        bail!("{}: found another ending, expected .gif or .mp4", path.display());
    };
    check_writable(path)?;
    let renderer = renderer::open(Backend::Auto)?;
    beside(work, |glimpses| {
        let Some(live) = LiveViewport::awaited(glimpses, &*renderer, SIZE)? else { return Ok(()) };
        let viewport = live.ended()?;
        // The interrupt that ended the flight does not stop its film; a second one ends the program.
        let film = filmed(viewport.pictures(), &|| true, |goes_on| {
            viewport.video(&Controls::default(), format, goes_on)
        })?;
        if let Some(film) = film {
            write_atomically(path, &film)?;
            say(path.display())?;
        }
        Ok(())
    })
}

/// Both at once, each in a thread.
fn beside<T: Send>(
    work: impl FnOnce(Sender<Glimpse>) -> T + Send,
    look: impl FnOnce(Receiver<Glimpse>) -> Result<()>,
) -> Result<T> {
    let (tell, glimpses) = channel();
    thread::scope(|scope| {
        let working = scope.spawn(|| work(tell));
        let looked = look(glimpses);
        let done = working.join().unwrap_or_else(|panic| resume_unwind(panic));
        looked.map(|()| done)
    })
}

//! Ctrl-C and SIGTERM: the first asks the loop to end after the current update, the second ends at once.

use std::process;
use std::sync::Arc;
use std::sync::atomic::{AtomicBool, Ordering};

use crate::output::warn;

/// Exit status of a process that a second interrupt ended: 128 + SIGINT, as shells report it.
const INTERRUPTED: i32 = 130;

/// Whether the user has asked the program to stop; clones share the answer.
#[derive(Clone, Debug, Default)]
pub struct Interrupt {
    requested: Arc<AtomicBool>,
}

/// Why interrupts cannot be watched.
#[derive(Debug, thiserror::Error)]
#[error("cannot watch for Ctrl-C: {0}")]
pub struct InterruptError(String);

impl Interrupt {
    /// Watches for Ctrl-C, SIGTERM and SIGHUP from now on.
    ///
    /// The first prints `farewell` (what happens next, one line) to standard error; the second ends the process
    /// with status 130.
    ///
    /// # Errors
    /// When the process already watches, or the system refuses.
    pub fn watch(farewell: &'static str) -> Result<Self, InterruptError> {
        let interrupt = Self::default();
        let handler = interrupt.clone();
        on_signals(move || handler.react(farewell))?;
        Ok(interrupt)
    }

    /// Ctrl-C, SIGTERM and SIGHUP are left to another process, which tells this one to end.
    ///
    /// # Errors
    /// When the process already watches, or the system refuses.
    pub fn leave_to_others() -> Result<(), InterruptError> {
        on_signals(|| ())
    }

    /// Whether to stop after the current update.
    pub fn requested(&self) -> bool {
        self.requested.load(Ordering::Relaxed)
    }

    /// Asks to stop, as a first Ctrl-C does.
    pub fn request(&self) {
        self.requested.store(true, Ordering::Relaxed);
    }

    fn react(&self, farewell: &str) {
        if self.requested() {
            process::exit(INTERRUPTED);
        }
        warn(format_args!("\n{farewell}")); // before the loop may know: it would end with nothing said
        self.request();
    }
}

#[cfg(not(target_family = "wasm"))]
fn on_signals(handler: impl FnMut() + Send + 'static) -> Result<(), InterruptError> {
    ctrlc::set_handler(handler).map_err(|error| InterruptError(error.to_string()))
}

/// A page has no signals.
#[cfg(target_family = "wasm")]
fn on_signals(_handler: impl FnMut() + Send + 'static) -> Result<(), InterruptError> {
    Err(InterruptError("there are no signals here".to_owned()))
}

#[cfg(unix)] // the signals are sent with kill
#[cfg(test)]
mod tests {
    use std::io::{BufRead, BufReader};
    use std::process::{Child, Command, Stdio};
    use std::time::Duration;

    use super::*;

    const ROLE: &str = "KESTREL_INTERRUPT_TEST_CHILD";

    #[test]
    fn a_request_is_seen_by_every_clone() {
        let interrupt = Interrupt::default();
        let seen = interrupt.clone();
        assert!(!seen.requested());
        interrupt.request();
        assert!(seen.requested());
    }

    /// Plays the training loop when the tests below start this binary again; passes at once otherwise.
    #[test]
    fn child() {
        let Ok(role) = std::env::var(ROLE) else { return };
        let interrupt = Interrupt::watch("stopping after this update").unwrap();
        assert!(Interrupt::watch("").unwrap_err().to_string().starts_with("cannot watch for Ctrl-C"));
        eprintln!("ready");
        while role == "deaf" || !interrupt.requested() {
            std::thread::sleep(Duration::from_millis(5));
        }
        eprintln!("stopped");
    }

    fn start(role: &str) -> (Child, impl FnMut(&str)) {
        let mut child = Command::new(std::env::current_exe().unwrap())
            .args(["--exact", "interrupt::tests::child", "--nocapture"])
            .env(ROLE, role)
            .stdout(Stdio::null())
            .stderr(Stdio::piped())
            .spawn()
            .unwrap();
        let mut lines = BufReader::new(child.stderr.take().unwrap()).lines();
        let await_line = move |expected: &str| {
            assert!(lines.by_ref().any(|line| line.unwrap() == expected), "never said {expected:?}");
        };
        (child, await_line)
    }

    fn send(signal: &str, child: &Child) {
        assert!(Command::new("kill").args([signal, &child.id().to_string()]).status().unwrap().success());
    }

    #[test]
    fn a_first_interrupt_lets_the_loop_end_by_itself() {
        for signal in ["-INT", "-TERM"] {
            let (mut child, mut await_line) = start("obedient");
            await_line("ready");
            send(signal, &child);
            await_line("stopping after this update");
            await_line("stopped");
            assert!(child.wait().unwrap().success());
        }
    }

    #[test]
    fn a_second_interrupt_ends_the_process_at_once() {
        let (mut child, mut await_line) = start("deaf");
        await_line("ready");
        send("-INT", &child);
        await_line("stopping after this update");
        send("-INT", &child);
        assert_eq!(child.wait().unwrap().code(), Some(INTERRUPTED));
    }
}

//! What the program says when a flight cannot begin, and how it ends.

#[cfg(unix)]
use std::io::{BufRead, BufReader};
use std::net::{TcpListener, UdpSocket};
#[cfg(unix)]
use std::process::Stdio;
use std::process::{Command, Output};

const POLICY: &str = concat!(env!("CARGO_MANIFEST_DIR"), "/../assets/pilots/hover.kestrel");

fn fly(arguments: &[&str]) -> Output {
    let mut command = Command::new(env!("CARGO_BIN_EXE_kestrel-shim"));
    command.args([POLICY, "--ground-station", "127.0.0.1:9", "--speed", "max"]);
    if !arguments.contains(&"--listen") {
        command.args(["--listen", "127.0.0.1:0"]);
    }
    command.args(arguments).output().expect("the program starts")
}

fn refusal(arguments: &[&str]) -> String {
    let output = fly(arguments);
    let text = String::from_utf8(output.stderr).expect("words");
    assert_eq!(output.status.code(), Some(2), "{text}");
    assert!(text.starts_with("error: ") && text.trim_end().lines().count() == 1, "one error: {text}");
    text
}

#[test]
fn what_cannot_be_had_is_one_clear_error() {
    let taken = UdpSocket::bind("127.0.0.1:0").unwrap();
    let address = taken.local_addr().unwrap().to_string();
    let text = refusal(&["--listen", &address]);
    assert!(text.contains(&format!("UDP address {address} is in use")), "{text}");

    let taken = TcpListener::bind("127.0.0.1:0").unwrap();
    let address = taken.local_addr().unwrap().to_string();
    let text = refusal(&["--tcp", &address]);
    assert!(text.contains(&format!("TCP address {address} is in use")), "{text}");

    for (arguments, expected) in [
        (["--tcp", "192.0.2.1:5760"], "cannot open TCP address 192.0.2.1:5760"),
        (["--serial", "no/such/device"], "cannot open serial device no/such/device"),
        (["--log", "no/such/folder/flight.tlog"], "cannot write the flight log no/such/folder/flight.tlog"),
    ] {
        let text = refusal(&arguments);
        assert!(text.contains(expected), "{text}");
    }
}

#[cfg(unix)]
#[test]
fn what_is_no_serial_device_is_one_clear_error() {
    let text = refusal(&["--serial", "/dev/null"]);
    assert!(text.contains("expected a serial device, found that /dev/null is none"), "{text}");
}

#[cfg(target_os = "linux")]
#[test]
fn a_full_disk_ends_the_flight_with_one_clear_error() {
    let text = refusal(&["--log", "/dev/full"]);
    assert!(text.contains("cannot write the flight log /dev/full"), "{text}");
}

#[cfg(unix)] // the signals are sent with kill
#[test]
fn an_interrupt_ends_the_flight_as_its_time_would() {
    for signal in ["-INT", "-TERM"] {
        let mut child = Command::new(env!("CARGO_BIN_EXE_kestrel-shim"))
            .args([POLICY, "--ground-station", "127.0.0.1:9", "--listen", "127.0.0.1:0"])
            .stdout(Stdio::piped())
            .spawn()
            .unwrap();
        let mut lines = BufReader::new(child.stdout.take().unwrap()).lines();
        assert!(lines.any(|line| line.unwrap().starts_with("Ctrl-C ends the flight")));
        assert!(Command::new("kill").args([signal, &child.id().to_string()]).status().unwrap().success());
        assert_eq!(child.wait().unwrap().code(), Some(0), "{signal}");
    }
}

#[test]
fn vehicles_fly_together_and_leave_a_log_each() {
    let folder = tempfile::tempdir().unwrap();
    let log = folder.path().join("flight.tlog");
    let output = fly(&["--vehicles", "4", "--for-secs", "2", "--log", log.to_str().unwrap()]);
    let text = String::from_utf8(output.stdout).unwrap();
    assert!(output.status.success() && text.contains("systems 1 to 4"), "{text}");
    for system in 1..=4 {
        assert!(folder.path().join(format!("flight-{system}.tlog")).exists());
    }
    assert!(!log.exists());
}

use super::*;

fn port(text: &str) -> SerialPort {
    text.parse().unwrap()
}

#[test]
fn a_port_is_a_path_and_perhaps_a_rate() {
    for (text, path, baud) in [
        ("/dev/ttyUSB0", "/dev/ttyUSB0", 57_600),
        ("/dev/ttyACM0:115200", "/dev/ttyACM0", 115_200),
        ("/dev/serial/by-id/usb-a:b", "/dev/serial/by-id/usb-a:b", 57_600),
        ("/dev/usb-a:b:9600", "/dev/usb-a:b", 9600),
    ] {
        assert_eq!(port(text), SerialPort { path: path.into(), baud });
    }
    for wrong in ["", ":57600", "/dev/ttyUSB0:", "/dev/ttyUSB0:0", "/dev/ttyUSB0:99999999999"] {
        let text = wrong.parse::<SerialPort>().unwrap_err().to_string();
        assert!(text.contains(&format!("found \"{wrong}\"")), "{text}");
    }
}

#[cfg(unix)]
mod lines {
    use std::io::{Read, Write};
    use std::thread;
    use std::time::{Duration, Instant};

    use mavlink::dialects::common::HEARTBEAT_DATA;
    use rustix::pty::{OpenptFlags, grantpt, openpt, ptsname, unlockpt};

    use super::*;
    use crate::testing::datagram;

    /// The far end of a pseudo-terminal, and the device at its near end.
    fn line() -> (File, SerialPort) {
        let far = openpt(OpenptFlags::RDWR | OpenptFlags::NOCTTY).unwrap();
        grantpt(&far).unwrap();
        unlockpt(&far).unwrap();
        let path = ptsname(&far, Vec::new()).unwrap().into_string().unwrap();
        (far.into(), port(&path))
    }

    /// The next frame, in whichever control period it comes.
    fn next(link: &mut SerialLink) -> Result<Vec<u8>, LinkError> {
        let start = Instant::now();
        let mut buffer = [0; DATAGRAM_LIMIT];
        loop {
            link.advance(0.0)?;
            if let Some(received) = link.receive(&mut buffer)? {
                return Ok(received.datagram.to_vec());
            }
            assert!(start.elapsed() < Duration::from_secs(20), "nothing comes");
            thread::sleep(Duration::from_millis(1));
        }
    }

    /// A heartbeat with bytes that a terminal would swallow, translate or obey.
    fn awkward() -> Vec<u8> {
        datagram(&HEARTBEAT_DATA {
            custom_mode: u32::from_le_bytes(*b"\x03\r\n\x11"),
            ..HEARTBEAT_DATA::default()
        })
    }

    #[test]
    fn frames_cross_the_line_in_both_directions_with_every_byte() {
        let (mut far, port) = line();
        let mut link = SerialLink::open(&port).unwrap();
        far.write_all(&[b"noise", &awkward()[..], &awkward()].concat()).unwrap();
        assert_eq!(next(&mut link).unwrap(), awkward());
        assert_eq!(next(&mut link).unwrap(), awkward());
        link.send_to(EndpointId::ONLY, &awkward());
        let every: Vec<u8> = (0..=255).collect();
        link.send_to(EndpointId::ONLY, &every);
        let mut bytes = vec![0; awkward().len() + every.len()];
        far.read_exact(&mut bytes).unwrap();
        assert_eq!(bytes, [awkward(), every].concat());
    }

    #[test]
    fn a_line_that_nobody_reads_costs_bounded_memory_and_no_time() {
        let (_far, port) = line();
        let mut link = SerialLink::open(&port).unwrap();
        (0..10_000).for_each(|_| link.send_to(EndpointId::ONLY, &awkward()));
        link.advance(0.0).unwrap();
        assert!((1..=WAITING_LIMIT).contains(&link.stream.waiting()));
    }

    #[test]
    fn a_device_in_use_is_named() {
        let (_far, port) = line();
        let _first = SerialLink::open(&port).unwrap();
        let error = SerialLink::open(&port).unwrap_err();
        assert!(matches!(error, LinkError::Busy { .. }), "{error}");
        assert!(error.to_string().contains(&port.path.display().to_string()), "{error}");
    }

    #[test]
    fn what_is_no_serial_device_is_refused() {
        for path in ["/dev/null", concat!(env!("CARGO_MANIFEST_DIR"), "/Cargo.toml")] {
            let error = SerialLink::open(&port(path)).unwrap_err();
            assert!(matches!(error, LinkError::NotSerial { .. }), "{error}");
        }
        for path in ["/dev/no-such-device", "/dev"] {
            let error = SerialLink::open(&port(path)).unwrap_err();
            assert!(matches!(error, LinkError::Open { .. }), "{error}");
        }
    }

    #[test]
    fn a_line_that_breaks_is_an_error() {
        let (far, port) = line();
        let mut link = SerialLink::open(&port).unwrap();
        drop(far);
        let error = next(&mut link).unwrap_err();
        assert!(matches!(error, LinkError::Failed { .. }), "{error}");
        link.send_to(EndpointId::ONLY, &awkward());
        assert!(link.advance(0.0).is_err());
    }
}

//! Serves a policy as a MAVLink vehicle for ten seconds: connect `QGroundControl`, pymavlink or MAVSDK to UDP 14550.
//!
//! Run it with `cargo run -p kestrel-shim --example serve_a_policy`.

use std::error::Error;
use std::path::Path;

use kestrel_core::airframe::CF2X;
use kestrel_shim::lockstep::Next;
use kestrel_shim::plant::FlatFloor;
use kestrel_shim::policy_bytes::PolicyBytes;
use kestrel_shim::session::{Session, SessionOptions};

fn main() -> Result<(), Box<dyn Error>> {
    serve(&SessionOptions { for_secs: Some(10.0), ..SessionOptions::default() })
}

fn serve(options: &SessionOptions) -> Result<(), Box<dyn Error>> {
    let path = Path::new(env!("CARGO_MANIFEST_DIR")).join("../assets/pilots/hover.kestrel");
    let bytes = PolicyBytes::read(&path)?;
    let mut floor = FlatFloor::new(&CF2X, bytes.policy()?.metadata().control_period_secs);
    let mut session = Session::open(&bytes, &CF2X, options)?;
    println!("{}", session.announcement());
    let counts = session.fly(&mut floor, &mut |_period| Next::Fly)?;
    println!("{} frames were received", counts.frames);
    Ok(())
}

#[test]
fn it_serves() {
    use kestrel_shim::lockstep::SimulationRate;
    let any_port = "127.0.0.1:0".parse().expect("an address");
    let options = SessionOptions {
        listen: any_port,
        speed: SimulationRate::Unthrottled,
        for_secs: Some(1.0),
        ..SessionOptions::default()
    };
    serve(&options).expect("it flies for a second");
}

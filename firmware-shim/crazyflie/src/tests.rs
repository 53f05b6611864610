//! The C interface beside the pilot that it wraps, and the committed header.

use std::path::Path;
use std::{env, fs};

use kestrel_core::action::ActionSpace;
use kestrel_core::airframe::CRAZYFLIE_2_1;
use kestrel_core::crc32::crc32;
use kestrel_core::policy_file::{PolicyError, PolicyFile};
use kestrel_core::setpoint::Setpoint;

use super::*;

const FOLDER: &str = env!("CARGO_MANIFEST_DIR");

/// A trained pilot, where a static starts.
fn hover() -> &'static [u8] {
    let file = fs::read(Path::new(FOLDER).join("../../assets/pilots/hover.kestrel")).unwrap();
    aligned(&file)
}

fn aligned(bytes: &[u8]) -> &'static [u8] {
    let mut words = vec![0_u64; bytes.len().div_ceil(8)];
    for (word, bytes) in words.iter_mut().zip(bytes.chunks(8)) {
        let mut whole = [0; 8];
        whole[..bytes.len()].copy_from_slice(bytes);
        *word = u64::from_ne_bytes(whole);
    }
    let words: &'static [u64] = words.leak();
    // SAFETY: as many bytes as were copied, which stay for ever.
    unsafe { slice::from_raw_parts(words.as_ptr().cast(), bytes.len()) }
}

#[test]
fn a_pilot_takes_no_more_than_it_needs() {
    let (seat, pilot) = (size_of::<Seat>(), size_of::<KestrelPilot>());
    // A pilot of a policy without a memory has 1.6 kB to spare.
    let spare = if cfg!(feature = "recurrent") { 256 } else { 1800 };
    assert!(pilot - seat < spare, "a seat of {seat} bytes lies in {pilot}");
}

fn state(step: u32) -> KestrelState {
    let wave = |phase: f32| 0.3 * (0.1 * step as f32 + phase).sin();
    KestrelState {
        position: [wave(0.0), wave(1.0), 1.0 + wave(2.0)],
        attitude: [0.99, 0.1 * wave(3.0), 0.1 * wave(4.0), 0.1 * wave(5.0)],
        velocity: [wave(6.0), wave(7.0), wave(8.0)],
        body_rates: [wave(9.0), wave(10.0), wave(11.0)],
    }
}

/// The same for the core.
fn core_state(state: &KestrelState) -> State<f32> {
    let [w, x, y, z] = state.attitude;
    State {
        position: Vector3::from(state.position),
        world_from_body: Attitude { w, x, y, z },
        velocity: Vector3::from(state.velocity),
        body_rates: Vector3::from(state.body_rates),
        rotor_speeds: [0.0; 4],
    }
}

#[test]
fn c_flies_as_the_pilot_does() {
    let mut pilot = KestrelPilot::new();
    // SAFETY: the policy stays for ever.
    assert_eq!(unsafe { kestrel_take_policy(&mut pilot, hover().as_ptr(), hover().len()) }, KESTREL_OK);
    let mut wrapped = Pilot::new(PolicyFile::parse(hover()).unwrap());
    assert_eq!(kestrel_control_period(&mut pilot), wrapped.policy().metadata().control_period_secs);
    let hover_speed_squared = wrapped.policy().metadata().action.hover_speed_squared();
    for step in 0..200 {
        if step == 100 {
            kestrel_reset(&mut pilot);
            wrapped.reset();
        }
        let (mut thrusts, state, goal) = ([9.0; 4], state(step), [0.1, 0.2, 1.0, 0.4]);
        assert_eq!(kestrel_tick(&mut pilot, &state, &goal, &mut thrusts), KESTREL_OK);
        let state = core_state(&state);
        let setpoint = Setpoint { yaw: 0.4, ..Setpoint::at(Vector3::new(0.1, 0.2, 1.0)) };
        for (thrust, speed) in thrusts.into_iter().zip(wrapped.tick_towards(&[], &state, &setpoint)) {
            assert!((thrust - speed.powi(2) / hover_speed_squared).abs() < 1e-6);
        }
        assert!(thrusts.iter().sum::<f32>() > 0.1);
    }
}

/// A policy that sees sixteen beams.
fn seeing() -> &'static [u8] {
    aligned(&fs::read(Path::new(FOLDER).join("../../assets/pilots/crosses.kestrel")).unwrap())
}

#[test]
fn a_policy_that_sees_sensors_flies_by_what_they_measure_and_not_without() {
    let mut pilot = KestrelPilot::new();
    assert_eq!(pilot.take(seeing()), KESTREL_OK);
    let mut wrapped = Pilot::new(PolicyFile::parse(seeing()).unwrap());
    let per_hover_thrust = 1.0 / wrapped.policy().metadata().action.hover_speed_squared();
    let goal = [4.5, 0.0, 0.3, 0.0];
    let mut tick = |measurements: &[f32], step: u32, thrusts: &mut [f32; 4]| {
        let (values, count) = (measurements.as_ptr(), measurements.len());
        // SAFETY: a slice.
        unsafe { kestrel_tick_measured(&mut pilot, &state(step), &goal, values, count, thrusts) }
    };
    for step in 0..100 {
        let beams: [f32; 16] = core::array::from_fn(|beam| ((beam as u32 + step) % 16) as f32 / 16.0);
        let mut thrusts = [9.0; 4];
        for unmeasured in [&beams[..15], &[], &[f32::NAN; 16]] {
            assert_eq!(tick(unmeasured, step, &mut thrusts), KESTREL_UNMEASURED);
            assert_eq!(thrusts, [0.0; 4]);
        }
        assert_eq!(tick(&beams, step, &mut thrusts), KESTREL_OK);
        let state = core_state(&state(step));
        let setpoint = Setpoint { yaw: 0.0, ..Setpoint::at(Vector3::new(4.5, 0.0, 0.3)) };
        let speeds = wrapped.tick_towards(&beams, &state, &setpoint);
        assert_eq!(thrusts.map(f32::to_bits), speeds.map(|speed| (speed * speed * per_hover_thrust).to_bits()));
    }
    let mut thrusts = [9.0; 4];
    assert_eq!(kestrel_tick(&mut pilot, &state(0), &goal, &mut thrusts), KESTREL_UNMEASURED);
    // SAFETY: nothing is read.
    let answer =
        unsafe { kestrel_tick_measured(&mut pilot, &state(0), &goal, core::ptr::null(), 0, &mut thrusts) };
    assert_eq!(answer, KESTREL_UNMEASURED);
}

#[test]
fn beams_are_cast_in_a_map_as_the_core_casts_them() {
    let (per_descent, normals, per_metre) =
        ([0.0, 1.0], [[1.0, 0.0, 0.0], [0.0, 0.0, 1.0]], [1.0, 1e6, 1e6, -1.0]);
    let slabs = [[(0, 3.0, 4.0), (1, 0.0, 2.0)], [(0, -1.0, -0.5), (1, 0.0, 2.0)]];
    let slabs = slabs.as_flattened();
    let of_c: Vec<_> = slabs.iter().map(|&(normal, low, high)| KestrelSlab { normal, low, high }).collect();
    let of_core: Vec<_> = slabs.iter().map(|&(normal, low, high)| Slab { normal, low, high }).collect();
    for near_scale in [0.0, 0.5] {
        let map = KestrelMap {
            limit: 4.0,
            near_scale,
            beams: 2,
            per_descent: per_descent.as_ptr(),
            normal_count: 2,
            normals: normals.as_ptr(),
            per_metre: per_metre.as_ptr(),
            sides: [[1, 0], [0, 2]].as_ptr(),
            slab_count: 4,
            slabs: of_c.as_ptr(),
            body_count: 2,
            bodies: [2, 2].as_ptr(),
        };
        let core = ScanMap {
            limit: 4.0,
            near_scale: (near_scale > 0.0).then_some(near_scale),
            per_descent: &per_descent,
            normals: &normals,
            per_metre: &per_metre,
            sides: &[[1, 0], [0, 2]],
            slabs: &of_core,
            bodies: &[2, 2],
        };
        for step in 0..50 {
            let (mut beams, mut expected) = ([9.0; 2], [9.0; 2]);
            let position = state(step).position;
            // SAFETY: the map's arrays are above, and there is room for two beams.
            unsafe { kestrel_scan(&map, &position, beams.as_mut_ptr()) };
            core.nearness(&position, &mut expected);
            assert_eq!(beams, expected);
            assert!(beams[0] > 0.0 && beams[1] > 0.0);
        }
    }
}

#[test]
fn a_drone_that_hovers_carries_a_quarter_of_its_weight_with_each_rotor() {
    let mut pilot = KestrelPilot::new();
    assert_eq!(kestrel_greatest_thrust(&mut pilot), 0.0);
    assert_eq!(pilot.take(hover()), KESTREL_OK);
    // The Crazyflie 2.1 has twice the thrust that it weighs.
    let drone = CRAZYFLIE_2_1;
    assert!((f64::from(kestrel_greatest_thrust(&mut pilot)) - drone.thrust_limit() / drone.weight()).abs() < 1e-4);
}

/// The trained pilot as one with a rate loop.
fn looped() -> &'static [u8] {
    let mut file = hover().to_vec();
    let ActionSpace::ThrustBodyRates(space) = PolicyFile::parse(hover()).unwrap().metadata().action else {
        panic!()
    };
    let numbers = space.hover_speed_squared.to_le_bytes();
    let place = file.windows(4).position(|window| window == numbers).unwrap() - 1;
    (file[place], file[18]) = (5, 6);
    let end = file.len() - 4;
    let checksum = crc32(&file[..end]);
    file[end..].copy_from_slice(&checksum.to_le_bytes());
    aligned(&file)
}

#[test]
fn between_two_ticks_a_rate_loop_follows_the_gyroscope_and_others_hold() {
    let (mut holding, mut following) = (KestrelPilot::new(), KestrelPilot::new());
    assert_eq!([holding.take(hover()), following.take(looped())], [KESTREL_OK; 2]);
    let ActionSpace::RateLoop(space) = PolicyFile::parse(looped()).unwrap().metadata().action else { panic!() };
    for step in 0..50 {
        let (mut held, mut followed) = ([9.0; 4], [9.0; 4]);
        let goal = [0.1, 0.2, 1.0, 0.0];
        assert_eq!(kestrel_tick(&mut holding, &state(step), &goal, &mut held), KESTREL_OK);
        assert_eq!(kestrel_tick(&mut following, &state(step), &goal, &mut followed), KESTREL_OK);
        assert_eq!(held, followed, "a tick is the same");
        let before = held;
        let rates = Vector3::from(state(step).body_rates) + Vector3::new(0.02, -0.03, 0.01);
        assert_eq!(kestrel_follow_rates(&mut holding, &rates.into(), &mut held), KESTREL_OK);
        assert_eq!(held, before);
        assert_eq!(kestrel_follow_rates(&mut following, &rates.into(), &mut followed), KESTREL_OK);
        for (rotor, (now, before)) in followed.into_iter().zip(before).enumerate() {
            let changed: f32 = (0..3)
                .map(|axis| space.mixer[rotor][axis] * space.rate_gains[axis] * [-0.02, 0.03, -0.01][axis])
                .sum();
            let most = space.speed_squared_limit / space.hover_speed_squared;
            let expected = (before + changed / space.hover_speed_squared).clamp(0.0, most);
            assert!((now - expected).abs() < 1e-4, "rotor {rotor}: {now}, expected {expected}");
        }
        let kept = followed;
        let wild = kestrel_follow_rates(&mut following, &[f32::NAN, 0.0, 0.0], &mut followed);
        assert_eq!((wild, followed), (KESTREL_BODY_RATES, kept));
    }
    assert_eq!(kestrel_follow_rates(&mut KestrelPilot::new(), &[0.0; 3], &mut [0.0; 4]), KESTREL_NO_POLICY);
}

#[test]
fn what_is_not_plausible_stops_and_says_which() {
    let mut pilot = KestrelPilot::new();
    assert_eq!(pilot.take(hover()), KESTREL_OK);
    for broken in [f32::NAN, f32::INFINITY, f32::NEG_INFINITY, 1e4, -1e30] {
        for number in 0..17 {
            let (mut state, mut goal) = (state(number), [0.0; 4]);
            let (value, expected) = match number {
                0..3 => (&mut state.position[number as usize], KESTREL_POSITION),
                3..7 => (&mut state.attitude[number as usize - 3], KESTREL_ATTITUDE),
                7..10 => (&mut state.velocity[number as usize - 7], KESTREL_VELOCITY),
                10..13 => (&mut state.body_rates[number as usize - 10], KESTREL_BODY_RATES),
                _ => (&mut goal[number as usize - 13], KESTREL_GOAL),
            };
            *value = broken;
            let mut thrusts = [9.0; 4];
            assert_eq!(kestrel_tick(&mut pilot, &state, &goal, &mut thrusts), expected);
            assert_eq!(thrusts, [0.0; 4]);
        }
    }
}

#[test]
fn a_damaged_policy_is_refused_by_a_number_and_nothing_flies() {
    let damaged = |change: fn(&mut Vec<u8>)| {
        let mut file = hover().to_vec();
        change(&mut file);
        aligned(&file)
    };
    let code = |error: PolicyError| i32::from(error.code());
    let cases = [
        (damaged(|file| file.truncate(100)), PolicyError::Truncated { found: 0, expected: 0 }),
        (damaged(|file| file.push(0)), PolicyError::TrailingBytes { found: 0, expected: 0 }),
        (damaged(|file| file[0] ^= 1), PolicyError::Magic { found: [0; 8], expected: [0; 8] }),
        (damaged(|file| file[8] = 200), PolicyError::NewerVersion { found: 0, newest: 0 }),
        (damaged(|file| *file.last_mut().unwrap() ^= 1), PolicyError::Checksum { found: 0, expected: 0 }),
    ];
    let mut pilot = KestrelPilot::new();
    for (policy, expected) in cases {
        assert_eq!(pilot.take(hover()), KESTREL_OK);
        assert_eq!(pilot.take(policy), code(expected), "{expected}");
        let mut thrusts = [9.0; 4];
        assert_eq!(kestrel_tick(&mut pilot, &state(0), &[0.0; 4], &mut thrusts), KESTREL_NO_POLICY);
        assert_eq!(thrusts, [0.0; 4]);
        assert_eq!(kestrel_control_period(&mut pilot), 0.0);
        kestrel_reset(&mut pilot);
    }
    assert_eq!(pilot.take(&hover()[1..]), code(PolicyError::Magic { found: [0; 8], expected: [0; 8] }));
    assert_eq!(pilot.take(&[]), code(PolicyError::Truncated { found: 0, expected: 0 }));
}

#[test]
fn the_header_is_the_committed_one() {
    let config = cbindgen::Config::from_file(Path::new(FOLDER).join("cbindgen.toml")).unwrap();
    let bindings = cbindgen::Builder::new().with_src(Path::new(FOLDER).join("src/lib.rs")).with_config(config);
    let mut header = Vec::new();
    bindings.generate().unwrap().write(&mut header);
    let path = Path::new(FOLDER).join("include/kestrel.h");
    if env::var_os("BLESS").is_some() {
        fs::write(&path, &header).unwrap();
    }
    let committed = fs::read(&path).unwrap_or_default();
    assert!(committed == header, "{} is out of date: BLESS=1 writes it anew", path.display());
}

/// Not a number (quiet, signalling), infinite, subnormal, zero, huge, about as large as the limits.
fn special(kind: u32, bits: u32) -> f32 {
    f32::from_bits(match kind {
        0 => (bits & 0x803f_ffff) | 0x7fc0_0000,
        1 => (bits & 0x803f_ffff) | 0x7f80_0001,
        2 => (bits & 0x8000_0000) | 0x7f80_0000,
        3 => bits & 0x807f_ffff,
        4 => bits & 0x8000_0000,
        5 => (bits & 0x80ff_ffff) | 0x7e00_0000,
        _ => (bits & 0x83ff_ffff) | 0x4000_0000,
    })
}

#[test]
fn twelve_thousand_states_with_special_values_are_refused_or_flown_as_the_core_flies() {
    let mut pilot = KestrelPilot::new();
    assert_eq!(pilot.take(hover()), KESTREL_OK);
    let mut wrapped = Pilot::new(PolicyFile::parse(hover()).unwrap());
    let per_hover_thrust = 1.0 / wrapped.policy().metadata().action.hover_speed_squared();
    let (mut noise, mut refused) = (1_u64, 0);
    let mut next = || {
        noise = noise.wrapping_mul(6_364_136_223_846_793_005).wrapping_add(1_442_695_040_888_963_407);
        (noise >> 32) as u32
    };
    for step in 0..12_000 {
        let (mut state, mut goal, mut thrusts) = (state(step), [0.1, 0.2, 1.0, 0.4], [9.0; 4]);
        let value = special(next() % 7, next());
        let numbers = state.position.iter_mut().chain(&mut state.attitude).chain(&mut state.velocity);
        let mut numbers = numbers.chain(&mut state.body_rates).chain(&mut goal);
        *numbers.nth(step as usize % 17).unwrap() = value;
        let answer = kestrel_tick(&mut pilot, &state, &goal, &mut thrusts);
        if answer != KESTREL_OK {
            refused += 1;
            assert_eq!(thrusts, [0.0; 4]);
            continue;
        }
        let flown = core_state(&state);
        let setpoint = Setpoint { yaw: goal[3], ..Setpoint::at(Vector3::new(goal[0], goal[1], goal[2])) };
        let speeds = wrapped.tick_towards(&[], &flown, &setpoint);
        assert_eq!(thrusts.map(f32::to_bits), speeds.map(|speed| (speed * speed * per_hover_thrust).to_bits()));
    }
    assert!((6_000..11_000).contains(&refused), "{refused}");
}

#[test]
fn weak_rotors_are_learned_when_it_is_asked_for_and_driven_harder() {
    let shares_of = |pilot: &mut KestrelPilot| {
        let mut shares = [0.0; 4];
        kestrel_rotor_shares(pilot, &mut shares);
        shares
    };
    let mut pilot = KestrelPilot::new();
    assert_eq!(kestrel_compensate_rotors(&mut pilot, true), KESTREL_NO_POLICY);
    assert_eq!(pilot.take(hover()), KESTREL_OK);
    assert_eq!(kestrel_compensate_rotors(&mut pilot, true), KESTREL_OK);
    let (mut plain, mut thrusts, mut sound) = (KestrelPilot::new(), [0.0; 4], [0.0; 4]);
    assert_eq!(plain.take(hover()), KESTREL_OK);
    // At the goal, upright and at rest, it sinks faster and faster: what it asks for is not what it gets.
    for step in 0..100 {
        let velocity = [0.0, 0.0, -0.01 * step as f32];
        let here = KestrelState {
            position: [0.0, 0.0, 1.0],
            attitude: [1.0, 0.0, 0.0, 0.0],
            velocity,
            body_rates: [0.0; 3],
        };
        assert_eq!(kestrel_compensate_rotors(&mut pilot, true), KESTREL_OK);
        assert_eq!(kestrel_tick(&mut pilot, &here, &[0.0, 0.0, 1.0, 0.0], &mut thrusts), KESTREL_OK);
        assert_eq!(kestrel_tick(&mut plain, &here, &[0.0, 0.0, 1.0, 0.0], &mut sound), KESTREL_OK);
    }
    let shares = shares_of(&mut pilot);
    assert!(shares.iter().all(|share| (0.4..0.95).contains(share)), "{shares:?}");
    assert!(thrusts.iter().sum::<f32>() > sound.iter().sum(), "{thrusts:?} {sound:?}");
    assert_eq!(shares_of(&mut plain), [1.0; 4]);
    kestrel_reset(&mut pilot);
    assert_eq!(shares_of(&mut pilot), shares);
    assert_eq!(kestrel_compensate_rotors(&mut pilot, false), KESTREL_OK);
    assert_eq!(shares_of(&mut pilot), [1.0; 4]);
}

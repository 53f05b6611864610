use kestrel_sim::camera::{Cpu, FIRST_SOLID, View};
use kestrel_sim::world::World;
use nalgebra::Vector3;

use super::*;
use crate::recorded_flight::{FlightRecording, Placement};
use crate::testing::{self, scenario, started};
use kestrel_core::attitude::Attitude;
use kestrel_sim::scenario::Scenario;

fn prepared(flight: FlightRecording, scenario: &Scenario) -> RecordedScene {
    RecordedScene::new(flight, scenario, "flight.recording").unwrap()
}

fn flown(name: &str, secs: f32) -> (FlightRecording, RecordedScene) {
    let scenario = scenario(name, secs);
    let flight = testing::flown(&scenario);
    (flight.clone(), prepared(flight, &scenario))
}

fn style(panels: &[Panel]) -> Style {
    Style { panels: panels.to_vec(), size: [48, 36], view_angle: 1.5, samples: 2, drone: 0 }
}

/// Label of the first drone.
fn drone(scenario: &Scenario) -> u16 {
    let World { solids, movables, .. } = &scenario.aviary.world;
    FIRST_SOLID + (solids.len() + movables.len()) as u16
}

#[test]
fn a_film_has_all_pictures_and_the_same_bytes_for_any_number_of_threads() {
    let (_, recorded) = flown("cross.yaml", 0.8);
    let (style, renderer) = (style(&Panel::ALL), Cpu::asked_for());
    let video = Video::new(&recorded, &style, &renderer);
    let mut told = Vec::new();
    let file = video.file(VideoFormat::Gif, |done| {
        told.push(done);
        true
    });
    let file = file.unwrap().unwrap();
    assert_eq!(told, [0, 16, video.pictures()]);
    let mut decoder = gif::DecodeOptions::new().read_info(&file[..]).unwrap();
    assert_eq!([decoder.width(), decoder.height()].map(usize::from), video.size());
    let mut frames = 0;
    while let Some(frame) = decoder.read_next_frame().unwrap() {
        frames += 1;
        let pause = if frames == video.pictures() { 150 } else { 0 };
        assert_eq!(frame.delay, 4 + pause, "hundredths of a second");
    }
    assert_eq!(frames, video.pictures());
    for threads in [1, 3] {
        let pool = rayon::ThreadPoolBuilder::new().num_threads(threads).build().unwrap();
        assert!(pool.install(|| video.file(VideoFormat::Gif, |_| true)).unwrap().unwrap() == file);
    }
    assert!(video.file(VideoFormat::Gif, |done| done == 0).unwrap().is_none(), "a stopped video is nothing");
}

#[test]
fn a_drone_is_chased_but_does_not_see_itself() {
    let (_, recorded) = flown("cross.yaml", 1.0);
    let own = drone(&scenario("cross.yaml", 1.0));
    let chase = Chase::of(&recorded, 0);
    for (index, moment) in recorded.moments().iter().enumerate() {
        let camera = camera([120, 90], VIEW_ANGLE);
        let view = on_board(&recorded, &moment.drones[0].placement);
        assert!(!recorded.seen(moment, 0).render(&camera, &view).labels.contains(&own));
        // Behind the solids of people's world are the two marks of the goal.
        let image = recorded.shown(moment).render(&camera, &chase.view(index as f32));
        let seen = image.labels.iter().filter(|label| **label == own + 2).count();
        assert!((15..2400).contains(&seen), "{seen} of 10800 pixels at {index}");
        let middle = image.labels.chunks(120).skip(20).take(50).flat_map(|row| &row[30..90]);
        assert!(2 * middle.filter(|label| **label == own + 2).count() > seen, "at {index}");
    }
}

#[test]
fn a_camera_looks_where_the_nose_points_and_not_where_the_drone_goes() {
    let scenario = scenario("hover.yaml", 1.0);
    let mut flight = started(&scenario);
    let aside = |index: u8| Placement {
        position: Vector3::new(0.0, 0.05 * f32::from(index), 1.0),
        attitude: Attitude { w: 1.0, x: 0.0, y: 0.0, z: 0.0 },
    };
    flight.drones[0].frames = (0..100).map(aside).collect();
    let chase = Chase::of(&prepared(flight, &scenario), 0);
    let forward = chase.view(25.0).forward;
    assert!(forward.x > 0.8 && forward.y.abs() < 1e-6, "{forward}");
}

#[test]
fn a_camera_stays_on_the_drones_side_of_walls() {
    let (_, recorded) = flown("cross.yaml", 2.0);
    let chase = Chase::of(&recorded, 0);
    for (index, moment) in recorded.moments().iter().enumerate() {
        let drone = moment.drones[0].placement.position.cast::<f64>();
        let eye = chase.view(index as f32).eye;
        let towards = View::towards(drone, eye, Vector3::z());
        let near = Camera { near_m: 0.001, ..camera([1, 1], 0.01) };
        let free = f64::from(recorded.still().render(&near, &towards).depths[0]);
        assert!(free > (eye - drone).norm(), "at {index} the wall is {free} m away");
    }
}

#[test]
fn facts_are_those_of_the_recording() {
    let (recording, recorded) = flown("cross.yaml", 1.0);
    let [first, .., last] = recorded.moments() else { panic!("a flight of a second") };
    let caption = recorded.caption(first, 0);
    assert_eq!((caption.secs, caption.episode_return, caption.ending), (0.0, Some(0.0), None));
    let caption = recorded.caption(last, 0);
    let total: f64 = recording.drones[0].rewards.iter().sum();
    assert!((caption.episode_return.unwrap() - total).abs() < 1e-12);
    assert_eq!(caption.ending, Some((recording.drones[0].ending.clone(), recording.drones[0].success)));
    let middle = recorded.moment(0.5);
    let steps = (0.5 / recorded.flight.control_secs + 0.01) as usize;
    let before: f64 = recording.drones[0].rewards[..steps].iter().sum();
    assert!((recorded.caption(&middle, 0).episode_return.unwrap() - before).abs() < 1e-12);
}

#[test]
fn a_start_is_a_flight_of_one_moment() {
    let scenario = scenario("aviaries/room-0.yaml", 5.0);
    let recorded = prepared(started(&scenario), &scenario);
    assert_eq!((recorded.moments().len(), recorded.secs()), (1, 0.0));
    let (style, renderer) = (style(&[Panel::Depth]), Cpu::asked_for());
    let video = Video::new(&recorded, &style, &renderer);
    let picture = video.at(0.0).unwrap();
    assert_eq!((picture.size, picture.clone()), (video.size(), video.at(99.0).unwrap()));
    assert!(video.file(VideoFormat::Gif, |_| true).unwrap().is_some());
}

#[test]
fn several_drones_see_each_other() {
    let scenario = scenario("aviaries/crossing-3.yaml", 6.0);
    let recorded = prepared(started(&scenario), &scenario);
    assert_eq!(recorded.drones(), 3);
    let moment = &recorded.moments()[0];
    let [from, to] = [0, 1].map(|drone| moment.drones[drone].placement.position.cast::<f64>());
    let view = View::towards(from, to, Vector3::z());
    let image = recorded.seen(moment, 0).render(&camera([64, 48], 0.6), &view);
    assert!(image.labels.contains(&(drone(&scenario) + 1)));
}

#[test]
fn what_no_camera_can_follow_is_refused() {
    let (mut flight, _) = flown("cross.yaml", 0.3);
    let scenario = scenario("cross.yaml", 0.3);
    let refused = |flight: &FlightRecording| {
        RecordedScene::new(flight.clone(), &scenario, "flight.recording").unwrap_err().to_string()
    };
    let placed = flight.drones[0].frames[2];
    flight.drones[0].frames[2].position = Vector3::new(1e9, 0.0, 0.0);
    let message = refused(&flight);
    assert!(message.starts_with("flight.recording: frame 2 of drone 0 is 1e9 m from the origin"), "{message}");
    let none = Attitude { w: 0.0, x: 0.0, y: 0.0, z: 0.0 };
    flight.drones[0].frames[2] = Placement { attitude: none, ..placed };
    assert!(refused(&flight).ends_with("an attitude of length 0: expected at most 1e5 m and a length of 1"));
    flight.drones[0].frames[2].position = Vector3::new(f32::NAN, 0.0, 0.0);
    assert!(refused(&flight).contains("frame 2 of drone 0 holds NaN"));
}

#[test]
fn a_flight_plays_25_pictures_per_second_and_pauses_at_its_end() {
    let scenario = scenario("cross.yaml", 1.0);
    let flight = testing::flown(&scenario);
    let file = flight_video(flight, &scenario, "flight", VideoFormat::Gif).unwrap();
    assert!(file.len() < 500_000, "{} bytes for a second", file.len());
    let mut decoder = gif::Decoder::new(&file[..]).unwrap();
    assert_eq!(decoder.repeat(), gif::Repeat::Infinite);
    let mut delays = Vec::new();
    while let Some(frame) = decoder.read_next_frame().unwrap() {
        delays.push(frame.delay);
    }
    let (last, others) = delays.split_last().unwrap();
    assert!(others.len() >= 24 && others.iter().all(|delay| *delay == 4) && *last == 154, "{delays:?}");
}

#[cfg(feature = "mp4")]
#[test]
fn an_mp4_is_smaller_and_the_same_for_any_number_of_threads() {
    let (_, recorded) = flown("cross.yaml", 0.8);
    let (style, renderer) = (Style { size: [241, 181], ..style(&[Panel::Chase]) }, Cpu::asked_for());
    let video = Video::new(&recorded, &style, &renderer);
    let file = video.file(VideoFormat::Mp4, |_| true).unwrap().unwrap();
    let film = video.file(VideoFormat::Gif, |_| true).unwrap().unwrap();
    assert!(file[4..8] == *b"ftyp" && file.len() < film.len(), "{} of {} bytes", file.len(), film.len());
    for threads in [1, 3] {
        let pool = rayon::ThreadPoolBuilder::new().num_threads(threads).build().unwrap();
        assert!(pool.install(|| video.file(VideoFormat::Mp4, |_| true)).unwrap().unwrap() == file);
    }
    assert!(video.file(VideoFormat::Mp4, |done| done == 0).unwrap().is_none(), "a stopped video is nothing");
}

#[test]
fn what_a_format_cannot_hold_is_refused() {
    let refused = |format: VideoFormat, size| format.check(size).map_err(|error| error.to_string());
    assert_eq!(refused(VideoFormat::Gif, [65_535, 1]), Ok(()));
    let expected = "found 65536x1 pixels, expected at most 65535 across and down in a GIF";
    assert_eq!(refused(VideoFormat::Gif, [65_536, 1]), Err(expected.to_owned()));
    #[cfg(feature = "mp4")]
    {
        assert_eq!([[640, 480], [1920, 1080], [4096, 2304]].map(h264::level), [Some(30), Some(40), Some(51)]);
        assert_eq!(refused(VideoFormat::Mp4, [8688, 1000]), Ok(()));
        assert!(refused(VideoFormat::Mp4, [8704, 16]).unwrap_err().contains("8688 across and down"));
        assert!(refused(VideoFormat::Mp4, [4096, 4096]).is_err());
    }
}

#[test]
fn a_recording_that_is_none_is_refused() {
    let scenario = scenario("cross.yaml", 0.2);
    let whole = testing::flown(&scenario);
    let refused = |flight: FlightRecording| {
        flight_video(flight, &scenario, "flight", VideoFormat::Gif).unwrap_err().to_string()
    };
    let mut empty = whole.clone();
    empty.drones[0].frames.clear();
    let none = "the recording of the flight holds no frames: expected at least one";
    assert_eq!(refused(empty), none);
    assert_eq!(refused(FlightRecording { drones: Vec::new(), ..whole.clone() }), none);
    let message = refused(FlightRecording { control_secs: 0.0, ..whole });
    assert_eq!(message, "the recording of the flight has a control period of 0 s: expected a positive number");
}

use kestrel_core::airframe::CF2X;
use kestrel_sim::world::{Shape, Solid};
use proptest::prelude::*;

use super::camera::Camera;
use super::canvas::{Depth, Paint, Vertex};
use super::*;

const RED: palette::Colour = [255.0, 0.0, 0.0];
const BLUE: palette::Colour = [0.0, 0.0, 255.0];

/// A drone that comes to the goal along a bow and stays, over a pillar.
fn recording(secs: f32) -> FlightRecording {
    let frame = |index: usize| {
        let share = libm::expf(-2.0 * index as f32 * 0.01);
        let (sine, cosine) = libm::sincosf(0.5 * share);
        FlightFrame {
            placement: Placement {
                position: Vector3::new(-0.4 * share, 0.3 * share * share, 1.0 + 0.2 * share),
                attitude: Attitude { w: cosine, x: 0.0, y: sine, z: 0.0 },
            },
            rotor_fractions: [0.667 + 0.3 * share, 0.667, 0.667 - 0.3 * share, 0.667],
        }
    };
    let frames = (0..=(secs * 100.0) as usize).map(frame).collect();
    FlightRecording {
        title: "hover-seed0-1".to_owned(),
        control_secs: 0.01,
        airframe: CF2X,
        drones: vec![DroneFlight {
            goal: Vector3::new(0.0, 0.0, 1.0),
            frames,
            rewards: Vec::new(),
            ending: String::new(),
            success: false,
        }],
        solids: vec![cuboid(Vector3::new(0.5, -0.1, 0.0), Vector3::new(0.7, 0.1, 1.0))],
        movables: Vec::new(),
        floor: Floor::Solid,
    }
}

/// Three of them side by side, the second half as long, and a box that slides.
fn formation(secs: f32) -> FlightRecording {
    let mut flight = recording(secs);
    let aside = |drone: &DroneFlight, metres: f32| {
        let mut drone = drone.clone();
        drone.goal.y += metres;
        drone.frames.iter_mut().for_each(|frame| frame.placement.position.y += metres);
        drone
    };
    let first = flight.drones[0].clone();
    flight.drones.extend([aside(&first, 0.5), aside(&first, 1.1)]);
    let half = flight.drones[1].frames.len() / 2;
    flight.drones[1].frames.truncate(half);
    let slide = |index: usize| Placement {
        position: Vector3::new(-0.5, 0.01 * index as f32, 0.1),
        attitude: Attitude::level(),
    };
    let outline = Outline::of(&Shape::Cylinder { radius: 0.1, half_height: 0.1 });
    flight.movables.push(MovingSolid { outline, placements: (0..30).map(slide).collect() });
    flight
}

fn cuboid(low: Vector3<f32>, high: Vector3<f32>) -> Outline {
    Outline::placed(&Solid::block("box", low.cast(), high.cast()))
}

fn alone(flight: &mut FlightRecording) -> &mut DroneFlight {
    &mut flight.drones[0]
}

fn decoded(bytes: &[u8]) -> (gif::Decoder<&[u8]>, Vec<gif::Frame<'static>>) {
    let mut decoder = gif::Decoder::new(bytes).unwrap();
    let mut frames = Vec::new();
    while let Some(frame) = decoder.read_next_frame().unwrap() {
        frames.push(frame.clone());
    }
    (decoder, frames)
}

fn blank() -> Canvas {
    Canvas::new([40, 30], [255.0; 3])
}

/// How much of the canvas is covered, in pixels, by a paint without green.
fn covered(canvas: &Canvas) -> f32 {
    canvas.colours.iter().map(|[_, green, _]| 1.0 - green / 255.0).sum()
}

fn corners(points: &[[f32; 2]], nearness: f32) -> Vec<Vertex> {
    points.iter().map(|&[x, y]| Vertex { x, y, nearness }).collect()
}

#[test]
fn a_flight_plays_25_pictures_per_second_and_pauses_at_its_end() {
    let bytes = flight_gif(&recording(1.0)).unwrap();
    let (decoder, frames) = decoded(&bytes);
    assert_eq!([decoder.width(), decoder.height()].map(usize::from), SIZE);
    assert_eq!(decoder.repeat(), gif::Repeat::Infinite);
    assert_eq!(frames.len(), 26);
    assert!(frames[..25].iter().all(|frame| frame.delay == 4));
    assert_eq!(frames[25].delay, 154);
}

#[test]
fn the_same_flight_gives_the_same_bytes_on_any_number_of_threads() {
    let flight = recording(0.4);
    let gifs = [1, 3].map(|threads| {
        let pool = rayon::ThreadPoolBuilder::new().num_threads(threads).build().unwrap();
        pool.install(|| flight_gif(&flight).unwrap())
    });
    assert!(gifs[0] == gifs[1]);
}

#[test]
fn the_decoded_film_ends_with_the_last_picture() {
    let flight = recording(0.4);
    let moments = playback::moments(&flight);
    let scene = scene::Scene::of(&flight, &moments);
    let shots = scene.shots(&moments);
    let expected = picture(&scene, shots.last().unwrap()).quantised();
    let (_, frames) = decoded(&flight_gif(&flight).unwrap());
    let mut shown = vec![0; SIZE[0] * SIZE[1]];
    for frame in &frames {
        for (index, &pixel) in
            frame.buffer.iter().enumerate().filter(|(_, pixel)| frame.transparent != Some(**pixel))
        {
            let (row, column) = (index / usize::from(frame.width), index % usize::from(frame.width));
            shown[(row + usize::from(frame.top)) * SIZE[0] + column + usize::from(frame.left)] = pixel;
        }
    }
    assert!(shown == expected);
}

#[test]
fn a_film_is_small() {
    let bytes = flight_gif(&recording(2.0)).unwrap().len();
    assert!(bytes < 500_000, "{bytes} bytes for two seconds");
}

#[test]
fn any_flight_can_be_drawn() {
    let whole = recording(0.1);
    let changed = |whole: &FlightRecording, change: &dyn Fn(&mut DroneFlight)| {
        let mut flight = whole.clone();
        change(alone(&mut flight));
        flight
    };
    let one = changed(&whole, &|drone| drone.frames.truncate(1));
    let no_floor = FlightRecording { floor: Floor::Absent, solids: vec![], ..one.clone() };
    let straight_above = changed(&one, &|drone| drone.goal = drone.frames[0].placement.position + Vector3::z());
    let at_goal = changed(&one, &|drone| drone.goal = drone.frames[0].placement.position);
    let slow_control = FlightRecording { control_secs: 0.5, ..whole.clone() };
    let strange_title = FlightRecording { title: "schön ".repeat(40), ..one.clone() };
    let many = FlightRecording { drones: vec![one.drones[0].clone(); 40], ..one.clone() };
    let flights = [
        (one, 1),
        (no_floor, 1),
        (straight_above, 1),
        (at_goal, 1),
        (slow_control, 126),
        (strange_title, 1),
        (formation(0.1), 3),
        (many, 1),
    ];
    for (flight, pictures) in flights {
        assert_eq!(decoded(&flight_gif(&flight).unwrap()).1.len(), pictures);
    }
}

#[test]
fn a_film_lasts_as_long_as_its_longest_flight_and_drones_stay_where_they_ended() {
    let flight = formation(0.8);
    let moments = playback::moments(&flight);
    assert_eq!(moments.len(), 21);
    let second = &flight.drones[1].frames;
    let [during, after] = [5, 15].map(|picture: usize| moments[picture].drones[1]);
    assert!(during.speed > 0.0 && during.flown == 5);
    assert_eq!(after.frame.placement.position, second.last().unwrap().placement.position);
    assert!(after.speed == 0.0 && after.flown < 15);
    // The box stops after 30 frames, 0.29 m from where it was.
    assert!((moments[20].movables[0].position.y - 0.29).abs() < 1e-6);
}

#[test]
fn the_camera_keeps_all_drones_in_the_picture() {
    let mut flight = formation(1.0);
    flight.drones[2].goal.y += 20.0;
    flight.drones[2].frames.iter_mut().for_each(|frame| frame.placement.position.y += 20.0);
    let moments = playback::moments(&flight);
    for (camera, moment) in tracking::cameras(&flight, &moments).iter().zip(&moments) {
        for drone in &moment.drones {
            let seen = camera.project(&[drone.frame.placement.position])[0];
            let inside =
                (0.0..SIZE[0] as f32).contains(&seen.x) && (0.0..(SIZE[1] - STRIP) as f32).contains(&seen.y);
            assert!(inside, "{seen:?} at {} s", moment.elapsed_secs);
        }
    }
}

#[test]
fn a_recording_that_is_none_is_refused() {
    let whole = recording(0.1);
    let mut empty = formation(0.1);
    empty.drones[1].frames.clear();
    assert_eq!(flight_gif(&empty), Err(AnimationError::Empty));
    let deserted = FlightRecording { drones: vec![], ..whole.clone() };
    assert_eq!(flight_gif(&deserted), Err(AnimationError::Empty));
    let timeless = FlightRecording { control_secs: 0.0, ..whole };
    assert_eq!(flight_gif(&timeless), Err(AnimationError::ControlPeriod(0.0)));
    let mut broken = formation(0.1);
    broken.drones[2].frames[3].placement.position.z = f32::NAN;
    assert_eq!(flight_gif(&broken), Err(AnimationError::NotFinite { drone: 2, frame: 3 }));
    let message = flight_gif(&broken).unwrap_err().to_string();
    assert_eq!(message, "frame 3 of drone 2 holds NaN or infinite numbers: expected finite ones");
}

#[test]
fn a_polygon_covers_its_area() {
    let mut canvas = blank();
    let triangle = corners(&[[5.3, 4.1], [30.9, 8.2], [12.4, 25.7]], 1.0);
    canvas.polygon(&triangle, Paint::opaque(RED), Depth::Solid);
    let area = 0.5 * (25.6_f32 * 21.6 - 7.1 * 4.1);
    assert!((covered(&canvas) - area).abs() < 0.02 * area, "{} of {area}", covered(&canvas));
}

#[test]
fn either_winding_covers_the_same() {
    let [mut clockwise, mut counter] = [blank(), blank()];
    let mut square = corners(&[[5.0, 5.0], [15.0, 5.0], [15.0, 15.0], [5.0, 15.0]], 1.0);
    clockwise.polygon(&square, Paint::opaque(RED), Depth::Solid);
    square.reverse();
    counter.polygon(&square, Paint::opaque(RED), Depth::Solid);
    assert_eq!((covered(&clockwise), covered(&counter)), (100.0, 100.0));
}

#[test]
fn what_is_nearer_hides_what_is_farther_in_either_order() {
    let square = |nearness| corners(&[[5.0, 5.0], [15.0, 5.0], [15.0, 15.0], [5.0, 15.0]], nearness);
    for near_first in [true, false] {
        let mut canvas = blank();
        let mut shapes = [(square(2.0), RED), (square(1.0), BLUE)];
        if !near_first {
            shapes.reverse();
        }
        for (shape, colour) in shapes {
            canvas.polygon(&shape, Paint::opaque(colour), Depth::Solid);
        }
        assert_eq!(canvas.colours[10 * 40 + 10], RED);
    }
}

#[test]
fn glass_lets_half_of_what_is_behind_through() {
    let mut canvas = blank();
    let square = corners(&[[5.0, 5.0], [15.0, 5.0], [15.0, 15.0], [5.0, 15.0]], 1.0);
    canvas.polygon(&square, Paint::opaque(RED), Depth::Solid);
    canvas.polygon(&square, Paint { colour: BLUE, opacity: 0.5 }, Depth::Tested);
    assert_eq!(canvas.colours[10 * 40 + 10], [127.5, 0.0, 127.5]);
}

#[test]
fn a_line_covers_its_width_and_a_thin_one_pales() {
    for width in [0.25, 1.0, 3.0] {
        let mut canvas = blank();
        let ends = [[5.0, 10.5], [35.0, 10.5]].map(|[x, y]| Vertex { x, y, nearness: 1.0 });
        canvas.line(ends, width, Paint::opaque(RED), Depth::Tested);
        let (found, expected) = (covered(&canvas), 30.0 * width);
        assert!((found - expected).abs() < 0.1 * expected, "{found} for {expected}");
    }
}

proptest! {
    #[test]
    fn no_shape_leaves_the_canvas(points in prop::collection::vec([-1e4_f32..1e4, -1e4_f32..1e4], 0..9)) {
        let mut canvas = blank();
        canvas.polygon(&corners(&points, 1.0), Paint::opaque(RED), Depth::Solid);
        prop_assert!(covered(&canvas).is_finite());
    }
}

#[test]
fn the_camera_sees_its_focus_in_the_middle_and_up_above() {
    let focus = Vector3::new(1.0, 2.0, 0.5);
    let camera = Camera::looking_at(Vector3::new(-1.0, 1.0, 1.5), focus);
    let seen = |point: Vector3<f32>| camera.project(&[point])[0];
    let (middle, above, left) =
        (seen(focus), seen(focus + Vector3::z() * 0.1), seen(focus + Vector3::new(-0.1, 0.2, 0.0)));
    assert!((middle.x - 240.0).abs() < 1e-3 && (middle.y - 152.0).abs() < 1e-3, "{middle:?}");
    assert!(above.y < middle.y && (above.x - middle.x).abs() < 1e-3);
    assert!(left.x < middle.x);
}

#[test]
fn nothing_behind_the_camera_is_seen() {
    let camera = Camera::looking_at(Vector3::zeros(), Vector3::x());
    let [behind, before] = [-1.0, 1.0].map(|x| Vector3::new(x, 0.1, 0.0));
    assert!(camera.project(&[behind]).is_empty());
    assert_eq!(camera.project(&[behind, before]).len(), 2);
    let triangle = [behind, before, Vector3::new(1.0, -0.1, 0.0)];
    let visible = camera.project(&triangle);
    assert_eq!(visible.len(), 4);
    assert!(visible.iter().all(|vertex| vertex.nearness > 0.0));
}

#[test]
fn between_two_frames_lies_their_middle() {
    let mut flight = recording(0.1);
    flight.control_secs = 0.08;
    let middle = playback::moments(&flight)[1].drones[0];
    let [first, second] = [0, 1].map(|frame: usize| flight.drones[0].frames[frame].placement.position);
    assert!((middle.frame.placement.position - first.lerp(&second, 0.5)).norm() < 1e-6);
    assert!((middle.speed - (second - first).norm() / 0.08).abs() < 1e-4);
}

#[test]
fn a_quaternion_that_changes_sign_turns_nothing() {
    let mut flight = recording(0.02);
    flight.control_secs = 0.08;
    let frames = &mut alone(&mut flight).frames;
    let Attitude { w, x, y, z } = frames[0].placement.attitude;
    frames[1].placement.attitude = Attitude { w: -w, x: -x, y: -y, z: -z };
    let middle = playback::moments(&flight)[1].drones[0].frame.placement.attitude;
    assert!((middle.w - w).abs() < 1e-6 && (middle.y - y).abs() < 1e-6);
}

fn first_opacities(flight: &FlightRecording) -> Vec<f32> {
    let moments = playback::moments(flight);
    let scene = scene::Scene::of(flight, &moments);
    scene.shots(&moments)[0].solids.iter().map(|solid| solid.opacity).collect()
}

#[test]
fn only_solids_before_a_drone_become_glass() {
    let mut flight = recording(0.02);
    // Everything lies between the camera and the drone, or beyond the drone, or aside.
    let heading = Vector3::new(0.4, -0.3, 0.0).normalize();
    let drone = flight.drones[0].frames[0].placement.position;
    let cube = |middle: Vector3<f32>| cuboid(middle.add_scalar(-0.05), middle.add_scalar(0.05));
    let moments = playback::moments(&flight);
    let eye = tracking::cameras(&flight, &moments)[0].position;
    flight.solids = vec![cube(drone.lerp(&eye, 0.5)), cube(drone + heading * 1.5), cube(eye - heading * 2.0)];
    assert_eq!(first_opacities(&flight), [0.1, 1.0, 1.0]);
}

#[test]
fn the_pad_under_the_drone_stays_opaque() {
    let mut flight = recording(0.02);
    let drone = flight.drones[0].frames[0].placement.position;
    alone(&mut flight).goal = drone + Vector3::new(0.2, 0.0, 0.0);
    let pad = |shift: f32| drone + Vector3::new(shift, shift, -0.1);
    flight.solids = vec![cuboid(pad(-1.0) - Vector3::z(), pad(1.0))];
    assert_eq!(first_opacities(&flight), [1.0]);
}

#[test]
fn drones_side_by_side_have_trails_of_their_own_colour() {
    let colours: Vec<_> = (0..6).map(|drone| palette::nearest(palette::trail(drone))).collect();
    let mut different = colours.clone();
    different.sort_unstable();
    different.dedup();
    assert_eq!(different.len(), 6, "{colours:?}");
    assert_eq!(palette::trail(7), palette::trail(1));
}

#[test]
fn every_letter_differs_from_every_other() {
    let letters: Vec<char> = (' '..='~').collect();
    for (index, &letter) in letters.iter().enumerate() {
        assert!(font::glyph(letter).iter().all(|row| row >> font::WIDTH == 0));
        let twin = letters[..index].iter().find(|&&other| font::glyph(other) == font::glyph(letter));
        assert_eq!(twin, None, "{letter}");
    }
    assert_eq!(font::glyph('°'), font::glyph('漢'));
}

#[test]
fn large_areas_keep_their_colour() {
    let bytes = palette::bytes();
    for colour in [palette::PAPER, palette::FLOOR, palette::GRID, palette::FACES[1]] {
        let index = usize::from(palette::nearest(colour));
        assert_eq!(bytes[3 * index..3 * index + 3], colour.map(|channel| channel as u8));
    }
}

#[test]
fn thrust_colours_go_from_cold_to_hot() {
    let [red, _, blue] = palette::thrust(0.0);
    assert!(blue > red);
    let [red, _, blue] = palette::thrust(1.0);
    assert!(red > blue);
    assert_eq!(palette::thrust(7.0), palette::thrust(1.0));
}

use super::super::memory::MemoryLink;
use super::*;

/// Datagrams of a run: a standard deviation of a share is 1 % at most.
const COUNT: u32 = 10_000;

/// Between two datagrams \[s\]; longer than [`HELD_LIMIT_SECS`] takes ten of them.
const STEP_SECS: f64 = 0.01;

fn plan(text: &str) -> FaultPlan {
    text.parse().unwrap()
}

/// When each number arrived \[s\], with its bytes, if number N is sent at N steps and received by a vehicle.
fn arrivals(text: &str) -> Vec<(f64, Vec<u8>)> {
    let (mut peer, end) = MemoryLink::pair();
    let mut link = FaultyLink::new(Box::new(end), &plan(text));
    let mut arrived = Vec::new();
    let mut buffer = [0; DATAGRAM_LIMIT];
    for step in 0..COUNT + 1000 {
        if step < COUNT {
            peer.send(&step.to_le_bytes());
        }
        let now_secs = f64::from(step) * STEP_SECS;
        link.advance(now_secs).unwrap();
        while let Some(received) = link.receive(&mut buffer).unwrap() {
            arrived.push((now_secs, received.datagram.to_vec()));
        }
    }
    arrived
}

fn numbers(text: &str) -> Vec<u32> {
    arrivals(text).iter().map(|(_, bytes)| u32::from_le_bytes(bytes[..].try_into().unwrap())).collect()
}

/// Whether a share of [`COUNT`] is its probability, up to five standard deviations: once in two million seeds it is not.
fn is_share(events: usize, probability: f64) -> bool {
    let count = f64::from(COUNT);
    let deviation = (probability * (1.0 - probability) / count).sqrt();
    (events as f64 / count - probability).abs() <= 5.0 * deviation
}

#[test]
fn a_plan_without_faults_changes_nothing() {
    assert_eq!(numbers("seed=3"), (0..COUNT).collect::<Vec<_>>());
}

#[test]
fn losses_and_duplicates_have_their_probabilities() {
    for probability in [0.0, 0.1, 0.3, 1.0] {
        let lost = COUNT as usize - numbers(&format!("loss={probability},seed=1")).len();
        assert!(is_share(lost, probability), "{lost} for {probability}");
        let doubled = numbers(&format!("duplicate={probability},seed=2")).len() - COUNT as usize;
        assert!(is_share(doubled, probability), "{doubled} for {probability}");
    }
}

#[test]
fn one_bit_is_flipped_with_its_probability() {
    let flipped = |number: usize, found: u32| (found ^ number as u32).count_ones();
    for probability in [0.0, 0.05, 1.0] {
        let found = numbers(&format!("corrupt={probability},seed=4"));
        let flips: Vec<u32> = found.iter().enumerate().map(|(number, &found)| flipped(number, found)).collect();
        assert!(flips.iter().all(|&flips| flips <= 1));
        assert!(is_share(flips.iter().sum::<u32>() as usize, probability));
    }
}

/// A datagram that is held back lets the next one pass, which therefore is not held back itself: of a chain with the states
/// "none waits" and "one waits" the second has the share p / (1 + p).
#[test]
fn neighbours_change_places_with_the_closed_form_of_their_probability() {
    for probability in [0.0, 0.2, 0.7, 1.0] {
        let order = numbers(&format!("reorder={probability},seed=5"));
        let mut sorted = order.clone();
        sorted.sort_unstable();
        assert_eq!(sorted, (0..COUNT).collect::<Vec<_>>(), "nothing is lost");
        let swaps = order.windows(2).filter(|pair| pair[0] == pair[1] + 1).count();
        let others = order.windows(2).filter(|pair| pair[0] > pair[1] + 1).count();
        assert!(is_share(swaps, probability / (1.0 + probability)), "{swaps} for {probability}");
        assert_eq!(others, 0, "only neighbours");
    }
}

#[test]
fn everything_is_late_by_the_delay_and_in_order() {
    let arrived = arrivals("delay=0.125,seed=6");
    assert_eq!(arrived.len(), COUNT as usize);
    for (number, (secs, bytes)) in arrived.iter().enumerate() {
        assert_eq!(bytes[..], (number as u32).to_le_bytes());
        let late_secs = secs - number as f64 * STEP_SECS;
        assert!((late_secs - 0.13).abs() < 1e-9, "the first step after 0.125 s, not {late_secs} s");
    }
}

#[test]
fn what_nothing_overtakes_is_not_held_back_for_ever() {
    let (mut peer, end) = MemoryLink::pair();
    let mut link = FaultyLink::new(Box::new(end), &plan("reorder=1"));
    let mut buffer = [0; DATAGRAM_LIMIT];
    peer.send(b"alone");
    link.advance(0.0).unwrap();
    assert!(link.receive(&mut buffer).unwrap().is_none());
    link.advance(HELD_LIMIT_SECS + 0.01).unwrap();
    assert_eq!(link.receive(&mut buffer).unwrap().unwrap().datagram, b"alone");
}

#[test]
fn the_same_seed_has_the_same_faults_and_another_one_others() {
    let all = "loss=0.1,duplicate=0.05,reorder=0.2,delay=0.03,corrupt=0.01";
    let first = arrivals(&format!("{all},seed=1"));
    assert_eq!(first, arrivals(&format!("{all},seed=1")));
    assert_ne!(first, arrivals(&format!("{all},seed=2")));
}

#[test]
fn each_direction_has_its_own_faults() {
    let (mut peer, end) = MemoryLink::pair();
    let mut link = FaultyLink::new(Box::new(end), &plan("received.loss=1,sent.duplicate=1"));
    let mut buffer = [0; DATAGRAM_LIMIT];
    peer.send(b"to the vehicle");
    link.advance(0.0).unwrap();
    assert!(link.receive(&mut buffer).unwrap().is_none());
    link.send_to(EndpointId::ONLY, b"to the peer");
    for _ in 0..2 {
        assert_eq!(peer.receive(&mut buffer).unwrap().unwrap().datagram, b"to the peer");
    }
    assert!(peer.receive(&mut buffer).unwrap().is_none());
}

#[test]
fn delayed_frames_leave_by_themselves_and_a_flood_is_bounded() {
    let (mut peer, end) = MemoryLink::pair();
    let mut link = FaultyLink::new(Box::new(end), &plan("sent.delay=0.5"));
    (0..3 * UNDERWAY).for_each(|_| link.send_to(EndpointId::ONLY, b"frame"));
    assert_eq!(link.sent.underway.len(), UNDERWAY);
    let mut buffer = [0; DATAGRAM_LIMIT];
    for (now_secs, expected) in [(0.49, 0), (0.5, UNDERWAY)] {
        link.advance(now_secs).unwrap();
        let arrived = std::iter::from_fn(|| peer.receive(&mut buffer).unwrap().map(|_| ())).count();
        assert_eq!(arrived, expected);
    }
}

#[test]
fn a_plan_reads_as_it_is_written() {
    let all = Faults { loss: 0.1, duplicate: 0.05, reorder: 0.2, delay_secs: 0.03, corrupt: 0.01 };
    let both = plan("loss=0.1,duplicate=0.05,reorder=0.2,delay=0.03,corrupt=0.01,seed=1");
    assert_eq!(both, FaultPlan { received: all, sent: all, seed: 1 });
    assert_eq!(plan("loss=0.5, sent.loss=0").sent, Faults::default());
}

#[test]
fn wrong_plans_say_what_was_expected() {
    for (wrong, expected) in [
        ("", "loss="),
        ("loss", "found \"loss\""),
        ("lost=0.1", "found \"lost=0.1\""),
        ("received.seed=1", "found \"received.seed=1\""),
        ("loss=1.1", "a probability of 0 to 1"),
        ("loss=nan", "a probability of 0 to 1"),
        ("sent.corrupt=-0.1", "a probability of 0 to 1"),
        ("delay=inf", "a delay of 0 to 5 s"),
        ("seed=-1", "a whole number"),
        ("loss=0.1,,seed=1", "found \"\""),
    ] {
        let text = wrong.parse::<FaultPlan>().unwrap_err().to_string();
        assert!(text.contains(expected), "{text}");
    }
}

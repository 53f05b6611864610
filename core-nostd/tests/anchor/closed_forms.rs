//! What the anchor must be on quadratics and Gaussians, where everything has a formula.

use kestrel_core::anchor::fixed::FixedAnchor;
use kestrel_core::anchor::{Anchor, MeanAnchor, proximal_share};
use proptest::prelude::*;

use crate::support::{FixedMemory, Memory, Numbers};

const PARAMETERS: usize = 40;

/// The objective `−½ (θ − optimum)ᵀ A (θ − optimum)` of a task, and the curvature H that its anchor is given.
struct Task {
    optimum: Vec<f32>,
    curvature: Vec<f32>,
    anchored_curvature: Vec<f32>,
}

impl Task {
    fn new(numbers: &mut Numbers) -> Self {
        Self {
            optimum: numbers.vector(PARAMETERS, -1.0, 1.0),
            curvature: numbers.octaves(PARAMETERS, -3.0, 3.0),
            anchored_curvature: numbers.octaves(PARAMETERS, -3.0, 3.0),
        }
    }

    /// Ascent gradient at `parameters`.
    fn gradient(&self, parameters: &[f32]) -> Vec<f32> {
        let terms = self.curvature.iter().zip(&self.optimum).zip(parameters);
        terms.map(|((curvature, optimum), parameter)| curvature * (optimum - parameter)).collect()
    }

    /// Where gradient descent on the task's loss and the anchor's ends.
    fn trained(&self, anchor: &Anchor<'_>) -> Vec<f32> {
        let mut parameters = vec![0.0; PARAMETERS];
        for _ in 0..100 {
            let mut gradient: Vec<f32> = self.gradient(&parameters).iter().map(|ascent| -ascent).collect();
            anchor.add_penalty_gradient(&parameters, 1.0, &mut gradient);
            for index in 0..PARAMETERS {
                let stiffness = self.curvature[index] + anchor.importance[index];
                parameters[index] -= 0.5 * gradient[index] / stiffness;
            }
        }
        parameters
    }
}

fn assert_near(found: &[f32], expected: &[f32], tolerance: f32) {
    for (index, (found, expected)) in found.iter().zip(expected).enumerate() {
        assert!((found - expected).abs() <= tolerance, "{index}: found {found}, expected {expected}");
    }
}

#[test]
fn with_its_gradient_a_trained_task_becomes_the_center() {
    let mut numbers = Numbers::new(1);
    let (mut with_gradient, mut at_the_end) = (Memory::new(PARAMETERS), Memory::new(PARAMETERS));
    for _ in 0..7 {
        let task = Task::new(&mut numbers);
        let parameters = task.trained(&with_gradient.anchor());
        with_gradient.anchor().consolidate(&parameters, &task.anchored_curvature, 1.0);
        with_gradient.anchor().newton_step(&task.gradient(&parameters));
        at_the_end.anchor().consolidate_at(&parameters, &task.anchored_curvature, 1.0);
        assert_near(&with_gradient.center, &at_the_end.center, 1e-5);
        assert_eq!(with_gradient.importance, at_the_end.importance);
    }
}

/// The theorem itself: however many tasks were, the sum of their gradients and curvatures is one anchor.
#[test]
fn the_anchors_force_is_the_sum_over_all_tasks() {
    let mut numbers = Numbers::new(2);
    let mut memory = Memory::new(PARAMETERS);
    let elsewhere = numbers.vector(PARAMETERS, -2.0, 2.0);
    let mut sum = [0.0_f64; PARAMETERS];
    for _ in 0..7 {
        let task = Task::new(&mut numbers);
        let parameters = numbers.vector(PARAMETERS, -1.0, 1.0);
        let gradient = task.gradient(&parameters);
        memory.anchor().consolidate(&parameters, &task.anchored_curvature, 1.0);
        memory.anchor().newton_step(&gradient);
        for (index, sum) in sum.iter_mut().enumerate() {
            let distance = f64::from(elsewhere[index]) - f64::from(parameters[index]);
            *sum += f64::from(gradient[index]) - f64::from(task.anchored_curvature[index]) * distance;
        }
    }
    let mut force = vec![0.0; PARAMETERS];
    memory.anchor().add_penalty_gradient(&elsewhere, -1.0, &mut force);
    for (found, expected) in force.iter().zip(sum) {
        assert!((f64::from(*found) - expected).abs() < 1e-5 * (1.0 + expected.abs()), "{found} {expected}");
    }
}

#[test]
fn any_number_of_tasks_leaves_their_weighted_mean_in_the_same_memory() {
    for tasks in [1, 7, 1000] {
        let mut numbers = Numbers::new(tasks);
        let mut memory = Memory::new(PARAMETERS);
        let (mut moments, mut weights) = ([0.0_f64; PARAMETERS], [0.0_f64; PARAMETERS]);
        for _ in 0..tasks {
            let parameters = numbers.vector(PARAMETERS, -1.0, 1.0);
            let curvature = numbers.octaves(PARAMETERS, -6.0, 6.0);
            memory.anchor().consolidate(&parameters, &curvature, 1.0);
            for index in 0..PARAMETERS {
                moments[index] += f64::from(curvature[index]) * f64::from(parameters[index]);
                weights[index] += f64::from(curvature[index]);
            }
        }
        for index in 0..PARAMETERS {
            let mean = moments[index] / weights[index];
            assert!((f64::from(memory.center[index]) - mean).abs() < 1e-5, "{tasks} tasks");
            assert!((f64::from(memory.importance[index]) / weights[index] - 1.0).abs() < 1e-4, "{tasks} tasks");
        }
        assert_eq!(bytes_of(&memory.center) + bytes_of(&memory.importance), 8 * PARAMETERS);
    }
}

fn bytes_of<T>(values: &[T]) -> usize {
    size_of_val(values)
}

#[test]
fn faded_importance_is_a_geometric_series() {
    let mut memory = Memory::new(1);
    for _ in 0..1000 {
        memory.anchor().consolidate(&[0.25], &[2.0], 0.95);
    }
    assert_near(&memory.importance, &[2.0 / 0.05], 1e-3);
    assert_near(&memory.center, &[0.25], 1e-7);
}

#[test]
fn the_identity_needs_one_vector_and_is_the_diagonal_of_ones() {
    let mut numbers = Numbers::new(3);
    let (mut memory, ones) = (Memory::new(PARAMETERS), [1.0; PARAMETERS]);
    let (mut center, mut tasks) = (vec![0.0; PARAMETERS], 0);
    for turn in 0..1000 {
        let parameters = numbers.vector(PARAMETERS, -1.0, 1.0);
        let mut mean = MeanAnchor { center: &mut center, tasks: &mut tasks };
        if turn % 300 == 299 {
            mean.consolidate_at(&parameters);
            memory.anchor().consolidate_at(&parameters, &ones, 1.0);
        } else {
            mean.consolidate(&parameters);
            memory.anchor().consolidate(&parameters, &ones, 1.0);
        }
        let gradient = numbers.vector(PARAMETERS, -1.0, 1.0);
        mean.newton_step(&gradient);
        memory.anchor().newton_step(&gradient);
    }
    assert_near(&center, &memory.center, 1e-5);
    let mean = MeanAnchor { center: &mut center, tasks: &mut tasks };
    let (mut moved, mut same) = ([0.5; PARAMETERS], [0.5; PARAMETERS]);
    mean.proximal_step(&mut moved, 1e-3);
    memory.anchor().proximal_step(&mut same, 1e-3);
    assert_near(&moved, &same, 1e-5);
    let (mut force, mut same) = ([0.0; PARAMETERS], [0.0; PARAMETERS]);
    mean.add_penalty_gradient(&moved, 1e-3, &mut force);
    memory.anchor().add_penalty_gradient(&moved, 1e-3, &mut same);
    assert_near(&force, &same, 1e-5);
}

#[test]
fn a_mean_anchor_is_the_mean_of_its_tasks() {
    let mut numbers = Numbers::new(4);
    let (mut center, mut tasks) = (vec![0.0; PARAMETERS], 0);
    let mut sums = [0.0_f64; PARAMETERS];
    for count in 1..=1000_u32 {
        let parameters = numbers.vector(PARAMETERS, -1.0, 1.0);
        MeanAnchor { center: &mut center, tasks: &mut tasks }.consolidate(&parameters);
        for (sum, parameter) in sums.iter_mut().zip(&parameters) {
            *sum += f64::from(*parameter);
        }
        if [1, 7, 1000].contains(&count) {
            let means = sums.map(|sum| (sum / f64::from(count)) as f32);
            assert_near(&center, &means, 1e-6);
            assert_eq!(tasks, count);
        }
    }
}

/// The proximal step minimises `½ (θ' − θ)² + rate · ½ S (θ' − c)²`, whose derivative it must therefore make zero.
#[test]
fn a_pull_is_the_proximal_step() {
    let mut memory = Memory { center: vec![0.7; 3], importance: vec![0.01, 1.0, 50.0] };
    for rate in [1e-4_f32, 1e-2, 1.0, 30.0] {
        let mut parameters = [-0.4_f32; 3];
        memory.anchor().proximal_step(&mut parameters, rate);
        for (parameter, importance) in parameters.iter().zip(&memory.importance) {
            let derivative = (parameter + 0.4) + rate * importance * (parameter - 0.7);
            assert!(derivative.abs() < 1e-6 * (1.0 + rate * importance), "{derivative}");
        }
    }
}

/// A linear policy with Gaussian actions has the mean `θ · x`; its Fisher information is `x² / σ²`.
#[test]
fn the_divergence_is_that_of_gaussian_policies() {
    let (center, parameter, observation, deviation) = (0.3_f32, -0.2_f32, 1.7_f32, 0.4_f32);
    let mut memory = Memory { center: vec![center], importance: vec![(observation / deviation).powi(2)] };
    let kullback_leibler = ((parameter - center) * observation / deviation).powi(2) / 2.0;
    assert!((memory.anchor().divergence(&[parameter]) / kullback_leibler - 1.0).abs() < 1e-6);
}

#[test]
fn the_divergence_of_a_million_parameters_is_summed_without_loss() {
    let mut numbers = Numbers::new(5);
    let length = 1_000_003;
    let mut memory =
        Memory { center: numbers.vector(length, -1.0, 1.0), importance: numbers.octaves(length, -10.0, 0.0) };
    let parameters = numbers.vector(length, -1.0, 1.0);
    let exact: f64 = (0..length)
        .map(|index| {
            let distance = f64::from(parameters[index]) - f64::from(memory.center[index]);
            0.5 * distance * distance * f64::from(memory.importance[index])
        })
        .sum();
    assert!((f64::from(memory.anchor().divergence(&parameters)) / exact - 1.0).abs() < 1e-5);
}

#[test]
fn what_no_task_needs_stays_free_and_finite() {
    let mut memory = Memory { center: vec![0.5, -0.0], importance: vec![0.0; 2] };
    memory.anchor().consolidate(&[3.0, 4.0], &[0.0, 0.0], 0.9);
    memory.anchor().newton_step(&[1.0, 0.0]);
    assert_eq!(memory.center, [0.5, 0.0]);
    let mut parameters = [1.5, -2.5];
    memory.anchor().proximal_step(&mut parameters, 1e30);
    assert_eq!(parameters, [1.5, -2.5]);
    assert_eq!(memory.anchor().divergence(&parameters), 0.0);
    let (mut center, mut tasks) = ([0.5], 0);
    let mut mean = MeanAnchor { center: &mut center, tasks: &mut tasks };
    mean.newton_step(&[1.0]);
    let mut free = [2.0];
    mean.proximal_step(&mut free, 1e30);
    assert_eq!((center, free), ([0.5], [2.0]));
}

#[test]
fn huge_rates_and_importances_are_stable() {
    let mut memory = Memory { center: vec![0.25; 4], importance: vec![f32::MIN_POSITIVE, 1.0, 1e30, f32::MAX] };
    memory.anchor().consolidate(&[0.25; 4], &[f32::MAX; 4], 1.0);
    let mut parameters = [1e3_f32, -1e3, 1e3, -1e3];
    for _ in 0..100 {
        memory.anchor().proximal_step(&mut parameters, f32::MAX);
    }
    assert_near(&parameters, &[0.25; 4], 1e-6);
}

/// The state for 64-64 policies with 18 observations: 5,640 parameters.
#[test]
fn the_state_has_the_bytes_that_it_claims() {
    let (float, fixed) = (Memory::new(5640), FixedMemory::new(5640));
    assert_eq!(bytes_of(&float.center) + bytes_of(&float.importance), 5640 * Anchor::BYTES_PER_PARAMETER);
    assert_eq!(bytes_of(&fixed.center) + bytes_of(&fixed.importance), 5640 * FixedAnchor::BYTES_PER_PARAMETER);
    assert_eq!(5640 * FixedAnchor::BYTES_PER_PARAMETER, 16_920);
    assert_eq!([Anchor::BYTES_PER_PARAMETER, FixedAnchor::BYTES_PER_PARAMETER], [8, 3]);
    assert_eq!([MeanAnchor::BYTES_PER_PARAMETER, MeanAnchor::COUNT_BYTES], [4, 4]);
}

#[test]
#[should_panic(expected = "one value per parameter of the anchor")]
fn parameters_of_another_network_are_refused() {
    Memory::new(3).anchor().proximal_step(&mut [0.0; 4], 1.0);
}

proptest! {
    #[test]
    fn a_share_is_never_a_whole(importance in 0.0_f32..f32::MAX, rate in 0.0_f32..f32::MAX, exponent in -60_i32..60) {
        for (importance, rate) in [(importance, rate), (2.0_f32.powi(exponent), 1.0), (f32::MAX, rate), (importance, 0.0)] {
            let share = proximal_share(importance, rate);
            prop_assert!((0.0..1.0).contains(&share), "{share}");
        }
    }

    #[test]
    fn a_pull_never_passes_its_center(center in -1e3_f32..1e3, start in -1e3_f32..1e3, odds in -20.0_f32..30.0) {
        let mut memory = Memory { center: vec![center], importance: vec![odds.exp2()] };
        let mut parameters = [start];
        memory.anchor().proximal_step(&mut parameters, 1.0);
        let (low, high) = (center.min(start), center.max(start));
        let rounding = 1e-6 * (center.abs() + start.abs());
        prop_assert!((low - rounding..=high + rounding).contains(&parameters[0]));
    }
}

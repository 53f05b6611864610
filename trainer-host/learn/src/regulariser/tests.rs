use super::*;
use crate::actor_critic::{Actor, ActorLengths, Critic, Gradient};
use crate::rollout::{ENV_BATCH, Rollout};
use kestrel_core::seed::{Purpose, Stream};

const INPUTS: usize = 5;
const OUTPUTS: usize = 3;

fn networks() -> (Actor, Critic) {
    let mut stream = Stream::new(Seed(1), 0, Purpose::Weights);
    let mut actor =
        Actor::state_based(ActorLengths { observation: INPUTS, action: OUTPUTS }, &[6], -0.7, &mut stream);
    actor.parameters_mut().iter_mut().for_each(|parameter| *parameter += 0.2 * stream.normal());
    (actor, Critic::state_based(INPUTS, &[4], 1, &mut stream))
}

/// A rollout of random observations.
fn rollout() -> Rollout {
    let mut stream = Stream::new(Seed(2), 0, Purpose::Actions);
    Rollout::of_observations((0..2 * INPUTS * ENV_BATCH).map(|_| stream.normal()).collect(), INPUTS, OUTPUTS)
}

/// A policy somewhere else.
fn moved(actor: &Actor, distance: f32, seed: u64) -> Actor {
    let mut stream = Stream::new(Seed(seed), 0, Purpose::Weights);
    let mut other = actor.clone();
    other.parameters_mut().iter_mut().for_each(|parameter| *parameter += distance * stream.normal());
    other
}

fn end(memory: &mut ShippedRegulariser, actor: &Actor, critic: &Critic, rollout: &Rollout) {
    let gradient = vec![0.01; actor.parameters().len()];
    let visited = [rollout.visited()];
    memory.consolidate(&EndedTask { actor, critic, gradient: &gradient, visited: &visited, seed: Seed(3) });
}

fn penalty(memory: &mut ShippedRegulariser, actor: &Actor, critic: &Critic) -> Vec<f32> {
    let mut gradient = Gradient::new(actor, critic);
    memory.add_gradient(Learning { actor, critic }, &mut gradient);
    gradient.actor
}

/// Divergence of the mean actions \[nat\] at the reference spread, over all samples of a rollout.
fn divergence(one: &Actor, other: &Actor, rollout: &Rollout) -> f64 {
    let mut sum = 0.0;
    for index in 0..rollout.slices() {
        let slice = rollout.slice(index);
        let mut means = [vec![0.0; OUTPUTS * ENV_BATCH], vec![0.0; OUTPUTS * ENV_BATCH]];
        one.act_mean(slice.batch, &mut means[0]);
        other.act_mean(slice.batch, &mut means[1]);
        let squares = means[0].iter().zip(&means[1]).map(|(a, b)| f64::from(a - b) * f64::from(a - b));
        sum += squares.sum::<f64>();
    }
    0.5 * sum / (rollout.slices() * ENV_BATCH) as f64 / f64::from(REFERENCE_STD * REFERENCE_STD)
}

fn quadratic(curvature: Curvature, gradient: GradientTerm) -> RegulariserSettings {
    let (coupling, strength) = (Coupling::Gradient, Strength::Fixed(2.0));
    RegulariserSettings::Quadratic(QuadraticSettings { curvature, gradient, coupling, strength, decay: 1.0 })
}

fn every_kind() -> Vec<RegulariserSettings> {
    let published = |rule| {
        RegulariserSettings::ReferenceSoar(ReferenceSoarSettings { rule, gradient_weight: 0.1, curvature: 0.1 })
    };
    vec![
        RegulariserSettings::None,
        quadratic(Curvature::Identity, GradientTerm::Measured),
        quadratic(Curvature::Fisher, GradientTerm::Balance),
        quadratic(Curvature::Sensitivity, GradientTerm::Absent),
        quadratic(Curvature::Kronecker, GradientTerm::Balance),
        RegulariserSettings::FunctionSpace(FunctionSpaceSettings { parts: 4, strength: 1.0 }),
        published(SoarRule::Literal),
        published(SoarRule::Absolute),
        published(SoarRule::Head),
        RegulariserSettings::SynapticIntelligence(SynapticIntelligenceSettings { strength: 1.0 }),
        RegulariserSettings::Coreset(CoresetSettings { bytes: Some(4096), strength: 1.0 }),
        compact(4096, Strength::Budget(0.005)),
        compact(4096, Strength::Fixed(1.0)),
    ]
}

fn compact(bytes: usize, strength: Strength) -> RegulariserSettings {
    RegulariserSettings::CompactCoreset(CompactCoresetSettings { bytes, strength, boundaries: Boundaries::Told })
}

#[test]
fn the_fisher_information_is_the_curvature_of_the_divergence() {
    let ((actor, _), rollout) = (networks(), rollout());
    let information = curvature::fisher(&actor, &[rollout.visited()]);
    for index in (0..information.len()).step_by(7) {
        let step = 1e-3_f32;
        let mut shifted = actor.clone();
        shifted.parameters_mut()[index] += step;
        let expected = 2.0 * divergence(&shifted, &actor, &rollout) / f64::from(step * step);
        let found = f64::from(information[index]);
        assert!((found - expected).abs() < 2e-2 * expected.max(1e-3), "{index}: {found}, not {expected}");
    }
}

#[test]
fn no_memory_grows_with_the_number_of_tasks_and_none_pulls_before_the_first() {
    let ((actor, critic), rollout) = (networks(), rollout());
    for settings in every_kind() {
        let mut memory = settings.begin(Learning { actor: &actor, critic: &critic });
        assert!(penalty(&mut memory, &actor, &critic).iter().all(|value| *value == 0.0), "{settings:?}");
        end(&mut memory, &actor, &critic, &rollout);
        let bytes = memory.stored_bytes();
        for seed in 0..6 {
            end(&mut memory, &moved(&actor, 0.1, seed), &critic, &rollout);
            assert!(memory.stored_bytes() <= bytes, "{settings:?}");
        }
    }
}

#[test]
fn the_bytes_are_those_of_two_vectors_or_one() {
    let (actor, critic) = networks();
    let parameters = actor.mlp().parameter_count();
    let bytes = |settings: &RegulariserSettings| {
        settings.begin(Learning { actor: &actor, critic: &critic }).stored_bytes()
    };
    assert_eq!(bytes(&quadratic(Curvature::Fisher, GradientTerm::Balance)), 8 * parameters + 12);
    assert_eq!(bytes(&quadratic(Curvature::Identity, GradientTerm::Balance)), 4 * parameters + 16);
    // Layers 5-6 and 6-3, each with a one beside its inputs.
    let matrices = (6 * 6 + 6 * 6) + (7 * 7 + 3 * 3);
    assert_eq!(bytes(&quadratic(Curvature::Kronecker, GradientTerm::Balance)), 4 * (parameters + matrices) + 12);
}

/// Divergence that an anchor predicts for a policy, and the true one.
fn predicted_and_true(actor: &Actor, curvature: Curvature, distance: f32) -> (f64, f64) {
    let ((_, critic), rollout) = (networks(), rollout());
    let mut memory = quadratic(curvature, GradientTerm::Balance).begin(Learning { actor, critic: &critic });
    end(&mut memory, actor, &critic, &rollout);
    let other = moved(actor, distance, 12);
    let ShippedRegulariser::Quadratic(quadratic) = &mut memory else { panic!("it is an anchor") };
    (f64::from(quadratic.divergence(&other)), divergence(&other, actor, &rollout))
}

#[test]
fn factors_predict_the_divergence_of_a_layer_and_that_of_two_better_than_a_diagonal() {
    let single = Actor::state_based(
        ActorLengths { observation: INPUTS, action: OUTPUTS },
        &[],
        -0.7,
        &mut Stream::new(Seed(4), 0, Purpose::Weights),
    );
    let (predicted, found) = predicted_and_true(&single, Curvature::Kronecker, 0.3);
    // But for what damping moves to other inputs: a hundredth of the mean.
    assert!((predicted / found - 1.0).abs() < 0.02, "{predicted}, not {found}");
    let ((actor, _), mut errors) = (networks(), [0.0; 2]);
    for (error, curvature) in errors.iter_mut().zip([Curvature::Kronecker, Curvature::Fisher]) {
        let (predicted, found) = predicted_and_true(&actor, curvature, 0.03);
        *error = (predicted / found).ln().abs();
    }
    assert!(errors[0] < errors[1], "{errors:?}");
}

#[test]
fn a_policy_that_has_moved_is_pulled_back_by_sound_methods_and_pushed_away_by_the_published_sign() {
    let ((actor, critic), rollout) = (networks(), rollout());
    for settings in every_kind() {
        let mut memory = settings.begin(Learning { actor: &actor, critic: &critic });
        // The path matters to synaptic intelligence: one step that lowered the loss.
        let stepped = moved(&actor, 0.05, 8);
        let mut gradient = Gradient::new(&actor, &critic);
        for ((gradient, now), before) in
            gradient.actor.iter_mut().zip(stepped.parameters()).zip(actor.parameters())
        {
            *gradient = before - now;
        }
        memory.add_gradient(Learning { actor: &actor, critic: &critic }, &mut gradient);
        let gradient = &Gradient::new(&actor, &critic);
        memory.after_step(&mut stepped.clone(), &OptimiserStep { gradient, scale: 1.0, learning_rate: 1e-3 });
        end(&mut memory, &stepped, &critic, &rollout);
        let other = moved(&stepped, 0.3, 9);
        let gradient = penalty(&mut memory, &other, &critic);
        let distance = other.parameters().iter().zip(stepped.parameters()).map(|(now, then)| now - then);
        let along: f32 = gradient.iter().zip(distance).map(|(penalty, distance)| penalty * distance).sum();
        match settings {
            RegulariserSettings::None => assert_eq!(along, 0.0),
            RegulariserSettings::ReferenceSoar(ReferenceSoarSettings { rule: SoarRule::Absolute, .. }) => {}
            RegulariserSettings::ReferenceSoar(_) => assert!(along < 0.0, "{settings:?} repels: {along}"),
            RegulariserSettings::Quadratic(_)
            | RegulariserSettings::FunctionSpace(_)
            | RegulariserSettings::SynapticIntelligence(_)
            | RegulariserSettings::Coreset(_)
            | RegulariserSettings::CompactCoreset(_) => assert!(along > 0.0, "{settings:?} attracts: {along}"),
        }
    }
}

#[test]
fn states_pull_along_the_divergence_however_far_the_policy_is() {
    let ((actor, critic), rollout) = (networks(), rollout());
    let coreset = RegulariserSettings::Coreset(CoresetSettings { bytes: Some(1 << 20), strength: 1.0 });
    let anchor = RegulariserSettings::FunctionSpace(FunctionSpaceSettings { parts: 4, strength: 1.0 });
    // A set this large is nearly the whole rollout; draws from a model are states like it.
    for (settings, tolerance) in [(coreset, 0.1), (anchor, 0.2)] {
        let mut memory = settings.begin(Learning { actor: &actor, critic: &critic });
        end(&mut memory, &actor, &critic, &rollout);
        for distance in [0.02, 0.2, 1.0] {
            let other = moved(&actor, distance, 4);
            let gradient = penalty(&mut memory, &other, &critic);
            let mut descended = other.clone();
            for (parameter, gradient) in descended.parameters_mut().iter_mut().zip(&gradient) {
                *parameter -= 1e-3 * gradient;
            }
            let squared: f64 = gradient.iter().map(|value| f64::from(value * value)).sum();
            let drop = divergence(&other, &actor, &rollout) - divergence(&descended, &actor, &rollout);
            let share = drop / (1e-3 * squared);
            assert!((share - 1.0).abs() < tolerance, "{settings:?} at {distance}: {share} of the predicted drop");
        }
    }
}

#[test]
fn an_anchor_in_the_actions_counts_every_task_and_goes_on_where_it_was() {
    let ((actor, critic), rollout) = (networks(), rollout());
    let mut memory = RegulariserSettings::FunctionSpace(FunctionSpaceSettings { parts: 4, strength: 1.0 })
        .begin(Learning { actor: &actor, critic: &critic });
    let other = moved(&actor, 0.2, 4);
    let mut sizes = [0.0_f32; 2];
    for size in &mut sizes {
        end(&mut memory, &actor, &critic, &rollout);
        let penalties: Vec<Vec<f32>> = (0..70).map(|_| penalty(&mut memory, &other, &critic)).collect();
        assert_ne!(penalties[0], penalties[1], "other states");
        assert_eq!(penalties[0], penalties[4], "the same four slices again");
        assert_ne!(penalties[0], penalties[64], "after sixteen times, others");
        *size = penalties.iter().map(|penalty| crate::network::dot(penalty, penalty).sqrt()).sum();
    }
    assert!((sizes[1] / sizes[0] - 2.0).abs() < 0.2, "{sizes:?}");
    let bytes = postcard::to_allocvec(&memory).unwrap();
    let mut read: ShippedRegulariser = postcard::from_bytes(&bytes).unwrap();
    assert_eq!(read, memory);
    for _ in 0..70 {
        assert_eq!(penalty(&mut read, &other, &critic), penalty(&mut memory, &other, &critic));
    }
    let ShippedRegulariser::FunctionSpace(anchor) = &memory else { panic!("it is an anchor") };
    assert_eq!(memory.training_bytes(), memory.stored_bytes() + anchor.state_bytes());
}

#[test]
fn with_its_gradient_kept_the_anchor_is_at_the_newest_policy() {
    let ((actor, critic), rollout) = (networks(), rollout());
    for curvature in [Curvature::Identity, Curvature::Fisher, Curvature::Kronecker] {
        let mut memory =
            quadratic(curvature, GradientTerm::Balance).begin(Learning { actor: &actor, critic: &critic });
        for seed in 0..3 {
            let newest = moved(&actor, 0.2, seed);
            end(&mut memory, &newest, &critic, &rollout);
            assert!(
                penalty(&mut memory, &newest, &critic).iter().all(|value| value.abs() < 1e-6),
                "{curvature:?}"
            );
        }
    }
}

#[test]
fn a_budget_pulls_the_harder_the_more_of_it_is_used() {
    let ((actor, critic), rollout) = (networks(), rollout());
    let settings = QuadraticSettings {
        curvature: Curvature::Fisher,
        gradient: GradientTerm::Balance,
        coupling: Coupling::Proximal,
        strength: Strength::Budget(0.1),
        decay: 1.0,
    };
    let mut memory = RegulariserSettings::Quadratic(settings).begin(Learning { actor: &actor, critic: &critic });
    end(&mut memory, &actor, &critic, &rollout);
    let mut step = |distance: f32| {
        let mut pulled = moved(&actor, distance, 1);
        let ShippedRegulariser::Quadratic(quadratic) = &mut memory else { panic!("it is an anchor") };
        let before = quadratic.divergence(&pulled);
        let gradient = &Gradient::new(&actor, &critic);
        quadratic.after_step(&mut pulled, &OptimiserStep { gradient, scale: 1.0, learning_rate: 0.1 });
        let expected = (before / 0.1) * (before / 0.1);
        assert!((quadratic.strength() - expected.min(100.0)).abs() < 1e-5 * expected.max(1.0), "{expected}");
        quadratic.divergence(&pulled) / before
    };
    let (near, far) = (step(0.01), step(0.2));
    assert!(far < near && near <= 1.0, "{near} of the divergence is left near the center, {far} far from it");
}

#[test]
fn the_published_means_are_none() {
    let ((actor, critic), rollout) = (networks(), rollout());
    let settings = ReferenceSoarSettings { rule: SoarRule::Head, gradient_weight: 0.0, curvature: 1.0 };
    let mut memory =
        RegulariserSettings::ReferenceSoar(settings).begin(Learning { actor: &actor, critic: &critic });
    let policies: Vec<Actor> = (0..3).map(|seed| moved(&actor, 0.2, seed)).collect();
    for policy in &policies {
        end(&mut memory, policy, &critic, &rollout);
    }
    // After three tasks the anchor is ⅓ θ₁ + ⅔ θ₂ + θ₃: its weights sum to two.
    let gradient = penalty(&mut memory, &actor, &critic);
    for index in 0..actor.parameters().len() {
        let [one, two, three] = [0, 1, 2].map(|task: usize| policies[task].parameters()[index]);
        let expected = one / 3.0 + two * 2.0 / 3.0 + three - actor.parameters()[index];
        assert!((gradient[index] - expected).abs() < 1e-5, "{index}: {}, not {expected}", gradient[index]);
    }
}

#[test]
fn distillation_teaches_a_policy_what_another_does_without_forgetting() {
    let ((actor, critic), rollout) = (networks(), rollout());
    let settings = CoresetSettings { bytes: Some(1 << 20), strength: 1.0 };
    let mut coreset = Coreset::new(&settings, Learning { actor: &actor, critic: &critic });
    let gradient = vec![0.0; actor.parameters().len()];
    let visited = [rollout.visited()];
    let ended =
        |actor| EndedTask { actor, critic: &critic, gradient: &gradient, visited: &visited, seed: Seed(5) };
    coreset.consolidate(&ended(&actor));
    let mut keeper = moved(&actor, 0.3, 6);
    let before = divergence(&keeper, &actor, &rollout);
    distil(&mut keeper, &ended(&actor), &coreset, &DistillationSettings { steps: 300, learning_rate: 1e-2 });
    let after = divergence(&keeper, &actor, &rollout);
    assert!(after < 0.02 * before, "{before} nat before, {after} after");
}

#[test]
fn a_compact_set_keeps_within_its_bytes_and_goes_on_where_it_was() {
    let ((actor, critic), rollout) = (networks(), rollout());
    for bytes in [1024, 1500, 4096] {
        let mut memory =
            compact(bytes, Strength::Budget(0.005)).begin(Learning { actor: &actor, critic: &critic });
        for task in 0..5 {
            end(&mut memory, &moved(&actor, 0.2, task), &critic, &rollout);
            assert!((bytes - 5 * INPUTS..=bytes).contains(&memory.stored_bytes()), "{task} tasks");
        }
        let other = moved(&actor, 0.3, 9);
        penalty(&mut memory, &other, &critic);
        let saved = postcard::to_allocvec(&memory).unwrap();
        let mut read: ShippedRegulariser = postcard::from_bytes(&saved).unwrap();
        assert_eq!(read, memory);
        for _ in 0..8 {
            assert_eq!(penalty(&mut read, &other, &critic), penalty(&mut memory, &other, &critic));
        }
    }
}

#[test]
fn a_compact_set_asks_for_what_the_newest_policy_did_however_many_tasks_there_were() {
    let ((actor, critic), rollout) = (networks(), rollout());
    let mut memory = compact(4096, Strength::Fixed(1.0)).begin(Learning { actor: &actor, critic: &critic });
    for task in 0..6 {
        let newest = moved(&actor, 0.2, task);
        end(&mut memory, &newest, &critic, &rollout);
        assert!(penalty(&mut memory, &newest, &critic).iter().all(|value| value.abs() < 1e-6), "{task}");
        // Its penalties, all states taken together, fall along the divergence in the states where the tasks led to.
        let other = moved(&newest, 0.1, 3);
        let mut gradient = vec![0.0; other.parameters().len()];
        for _ in 0..400 {
            for (sum, value) in gradient.iter_mut().zip(penalty(&mut memory, &other, &critic)) {
                *sum += value / 400.0;
            }
        }
        let mut descended = other.clone();
        for (parameter, gradient) in descended.parameters_mut().iter_mut().zip(&gradient) {
            *parameter -= 1e-3 * gradient;
        }
        let squared: f64 = gradient.iter().map(|value| f64::from(value * value)).sum();
        let drop = divergence(&other, &newest, &rollout) - divergence(&descended, &newest, &rollout);
        let share = drop / (1e-3 * squared);
        // Places between states are nearer to the middle than the states are.
        assert!((0.8..1.8).contains(&share), "{share} of the predicted drop after task {task}");
    }
}

#[test]
fn the_strength_rises_until_the_policy_is_within_its_budget_and_falls_there() {
    let ((actor, critic), rollout) = (networks(), rollout());
    let mut memory = compact(4096, Strength::Budget(0.005)).begin(Learning { actor: &actor, critic: &critic });
    end(&mut memory, &actor, &critic, &rollout);
    let mut after = |policy: &Actor| {
        for _ in 0..200 {
            penalty(&mut memory, policy, &critic);
        }
        let ShippedRegulariser::CompactCoreset(set) = &memory else { panic!("it is a compact set") };
        set.strength()
    };
    let far = after(&moved(&actor, 0.3, 9));
    assert!(far > 5.0, "{far} outside of the budget");
    let near = after(&actor);
    assert!(near < 0.2 * far, "{near} within it");
}

/// Where nobody tells, the states of the rollout before are kept once a rollout is of another world, for the policy that flew this one.
#[test]
fn a_compact_set_that_is_told_nothing_keeps_what_the_rollout_before_another_world_has_seen() {
    let ((actor, critic), rollout) = (networks(), rollout());
    let other = Rollout::of_observations(
        rollout.visited().slices.concat().iter().map(|value| value + 1.0).collect(),
        INPUTS,
        OUTPUTS,
    );
    let settings = |boundaries| {
        let settings = CompactCoresetSettings { bytes: 4096, strength: Strength::Fixed(1.0), boundaries };
        RegulariserSettings::CompactCoreset(settings)
    };
    assert!(settings(Boundaries::Found).finds_boundaries() && !settings(Boundaries::Told).finds_boundaries());
    let begin = |boundaries| settings(boundaries).begin(Learning { actor: &actor, critic: &critic });
    let (mut told, mut found) = (begin(Boundaries::Told), begin(Boundaries::Found));
    assert!(found.watches() && !told.watches());
    let mut sees = |rollout: &Rollout, actor: &Actor| {
        let visited = [rollout.visited()];
        found.watch(&Flight { actor, visited: &visited, seed: Seed(3) })
    };
    let last = moved(&actor, 0.1, 1);
    assert_eq!([sees(&rollout, &actor), sees(&rollout, &last), sees(&other, &last)], [false, false, true]);
    end(&mut told, &last, &critic, &rollout);
    assert_eq!(found.stored_bytes(), told.stored_bytes());
    assert_eq!(found.training_bytes(), told.training_bytes(), "nothing is kept to be compared");
    let moved = moved(&last, 0.1, 2);
    let (told, found) = (penalty(&mut told, &moved, &critic), penalty(&mut found, &moved, &critic));
    assert_eq!(told, found, "the same states, codes once packed are packed to the same");
    assert!(told.iter().any(|value| *value != 0.0));
}

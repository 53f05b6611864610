//! Output layers that learn in integers.

use kestrel_core::anchor::fixed::{FixedAnchor, Fraction, ProximalShares, importance_code};
use kestrel_core::fixed::{FixedMlp, FixedScratch, OutputLearner};
use kestrel_core::observation::PILOT_LEN;
use kestrel_core::policy_file::PolicyFile;

use crate::support::{Model, Random};

const OUTPUTS: usize = 4;

/// Weights of 64 features and a bias, in each row.
const PARAMETERS: usize = OUTPUTS * 65;

/// Observations, and a matrix that says what is to be done on their features.
struct Lesson {
    random: Random,
    /// Where the observations lie, in ±1 of it.
    middle: f32,
    taught: Vec<f32>,
}

impl Lesson {
    fn new(seed: u64, middle: f32) -> Self {
        let mut random = Random(seed);
        let taught = (0..PARAMETERS).map(|_| random.within(0.08)).collect();
        Self { random, middle, taught }
    }

    fn features(&mut self, network: &FixedMlp<'_>) -> Vec<i16> {
        let observation: Vec<f32> = (0..PILOT_LEN)
            .map(|index| self.random.within(1.0) + if index < 6 { self.middle } else { 0.0 })
            .collect();
        network.features(&observation, &mut FixedScratch::new()).to_vec()
    }

    fn target(&self, features: &[i16]) -> [f32; OUTPUTS] {
        let real: Vec<f32> = features.iter().map(|feature| f32::from(*feature) / 8192.0).chain([1.0]).collect();
        let row = |row: usize| {
            self.taught[row * 65..][..65].iter().zip(&real).map(|(weight, value)| weight * value).sum()
        };
        core::array::from_fn(row)
    }

    /// Mean magnitude of the error over a thousand observations.
    fn error(&mut self, network: &FixedMlp<'_>, learner: &OutputLearner<'_>) -> f32 {
        let mut sum = 0.0;
        for _ in 0..1_000 {
            let features = self.features(network);
            let (action, target) = (learner.act(&features), self.target(&features));
            sum += action.iter().zip(target).map(|(action, target)| (action - target).abs()).sum::<f32>();
        }
        sum / (1_000 * OUTPUTS) as f32
    }
}

fn with_network(test: impl FnOnce(&PolicyFile<'_>, &FixedMlp<'_>)) {
    let file = Model::typical(5).fixed_file();
    let policy = PolicyFile::parse(&file).unwrap();
    test(&policy, policy.fixed().unwrap());
}

#[test]
fn it_begins_with_what_the_network_does() {
    with_network(|policy, network| {
        assert_eq!(OutputLearner::parameters_of(network), PARAMETERS);
        assert!(OutputLearner::new(network, &mut [0; PARAMETERS - 1]).is_none());
        let mut memory = [0; PARAMETERS];
        let learner = OutputLearner::new(network, &mut memory).unwrap();
        let mut random = Random(1);
        for _ in 0..1_000 {
            let observation: Vec<f32> = (0..PILOT_LEN).map(|_| random.within(2.0)).collect();
            let expected = policy.act(&observation, &mut policy.scratch());
            let found = learner.act(network.features(&observation, &mut FixedScratch::new()));
            // Half a unit of the bias.
            assert!(expected.iter().zip(found).all(|(expected, found)| (expected - found).abs() < 1e-4));
        }
    });
    let float = Model::typical(5).float_file();
    assert!(PolicyFile::parse(&float).unwrap().fixed().is_none());
}

#[test]
fn a_whole_step_reaches_its_target() {
    with_network(|_, network| {
        let mut memory = [0; PARAMETERS];
        let mut learner = OutputLearner::new(network, &mut memory).unwrap();
        let mut lesson = Lesson::new(2, 0.0);
        for _ in 0..100 {
            let features = lesson.features(network);
            let target = lesson.target(&features);
            // A first step takes an action off its limit, behind which the sum may lie far away.
            for _ in 0..20 {
                learner.learn(&features, &target, Fraction::ONE);
            }
            let action = learner.act(&features);
            assert!(
                action.iter().zip(target).all(|(action, target)| (action - target).abs() < 2e-3),
                "{action:?} {target:?}"
            );
        }
    });
}

#[test]
fn small_steps_add_up_as_in_exact_arithmetic() {
    with_network(|_, network| {
        let mut memory = [0; PARAMETERS];
        let mut learner = OutputLearner::new(network, &mut memory).unwrap();
        let mut lesson = Lesson::new(3, 0.0);
        let rate = Fraction::nearest(0.02);
        let before = lesson.error(network, &learner);
        let mut exact: Vec<f64> = learner.parameters().iter().map(|parameter| f64::from(*parameter)).collect();
        for _ in 0..20_000 {
            let features = lesson.features(network);
            let target = lesson.target(&features);
            let action = learner.learn(&features, &target, rate);
            // The same errors: it is the rounding of the parameters that is looked at.
            let real: Vec<f64> =
                features.iter().map(|feature| f64::from(*feature) / 8192.0).chain([1.0]).collect();
            let energy: f64 = 1.0 + real[..64].iter().map(|value| value * value).sum::<f64>();
            for (index, parameter) in exact.iter_mut().enumerate() {
                let error = f64::from(target[index / 65].clamp(-1.0, 1.0) - action[index / 65]);
                *parameter += 0.02 * error * real[index % 65] / energy * units(network);
            }
        }
        let after = lesson.error(network, &learner);
        assert!(after < 0.1 * before, "{before} before, {after} after");
        let squares: f64 =
            exact.iter().zip(learner.parameters()).map(|(exact, found)| (exact - f64::from(*found)).powi(2)).sum();
        let rms = (squares / PARAMETERS as f64).sqrt();
        assert!(rms < 60.0, "{rms} units apart");
    });
}

/// Units of an output weight in one, from the answer to a feature of one.
fn units(network: &FixedMlp<'_>) -> f64 {
    let mut memory = [0; PARAMETERS];
    let mut learner = OutputLearner::new(network, &mut memory).unwrap();
    learner.parameters_mut().fill(0);
    learner.parameters_mut()[64] = 1;
    1.0 / f64::from(learner.act(&[])[0])
}

#[test]
fn what_is_no_number_or_out_of_reach_teaches_nothing() {
    with_network(|_, network| {
        let mut memory = [0; PARAMETERS];
        let mut learner = OutputLearner::new(network, &mut memory).unwrap();
        let features = Lesson::new(4, 0.0).features(network);
        let before = learner.parameters().to_vec();
        learner.learn(&features, &[f32::NAN; OUTPUTS], Fraction::ONE);
        learner.learn(&features, &[], Fraction::ONE);
        learner.learn(&features, &[1.0; OUTPUTS], Fraction::from_bits(0));
        assert_eq!(learner.parameters(), before);

        for _ in 0..50 {
            learner.learn(
                &features,
                &[f32::INFINITY, f32::MAX, f32::NEG_INFINITY, -7.0],
                Fraction::from_bits(u32::MAX),
            );
        }
        let action = learner.act(&features);
        assert!(
            action
                .iter()
                .take(4)
                .zip([1.0, 1.0, -1.0, -1.0])
                .all(|(action, limit): (&f32, f32)| (action - limit).abs() < 2e-3),
            "{action:?}"
        );
    });
}

#[test]
fn an_anchor_keeps_an_earlier_lesson() {
    with_network(|_, network| {
        let errors = [false, true].map(|anchored| {
            let mut memory = [0; PARAMETERS];
            let mut learner = OutputLearner::new(network, &mut memory).unwrap();
            let (mut first, mut second) = (Lesson::new(5, -0.8), Lesson::new(6, 0.8));
            let (rate, shares) = (Fraction::nearest(0.05), ProximalShares::at(Fraction::nearest(0.03)));
            let (mut center, mut importance) = ([0; PARAMETERS], [0; PARAMETERS]);
            let mut curvature = [0.0_f32; PARAMETERS];
            for _ in 0..10_000 {
                let features = first.features(network);
                learner.learn(&features, &first.target(&features), rate);
                for (index, sum) in curvature.iter_mut().enumerate() {
                    let feature = features.get(index % 65).map_or(1.0, |feature| f32::from(*feature) / 8192.0);
                    *sum += feature * feature / 10_000.0;
                }
            }
            let mut anchor = FixedAnchor { center: &mut center, importance: &mut importance };
            anchor.consolidate(learner.parameters(), &curvature.map(importance_code), Fraction::ONE, 0);
            for call in 0..2_000 {
                let features = second.features(network);
                learner.learn(&features, &second.target(&features), rate);
                if anchored {
                    anchor.proximal_step(learner.parameters_mut(), &shares, call);
                }
            }
            [first.error(network, &learner), second.error(network, &learner)]
        });
        let [[free, _], [anchored, learned]] = errors;
        assert!(anchored < 0.6 * free, "{free} without the anchor, {anchored} with it");
        assert!(learned < 0.2, "{learned}");
    });
}

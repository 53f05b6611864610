//! Several agents of an environment learn together.

use super::*;

/// Teams whose members' episodes end alone.
fn team(agents: usize) -> Task {
    Task { agents, ..task(true) }
}

/// The critic of MAPPO.
fn mappo() -> PpoSettings {
    PpoSettings { critic_scope: CriticScope::Team, value_scale: ValueScaling::PopArt, ..settings() }
}

fn collection(trainer: &Trainer) -> Collection<'_> {
    Collection {
        networks: Networks { actor: trainer.actor(), critic: trainer.critic(), encoders: &trainer.encoders },
        first_step: 0,
        reward_scale: 1.0,
        discount: 0.98,
        gae_lambda: 0.95,
        asks_teacher: false,
    }
}

#[test]
fn all_agents_of_all_environments_act() {
    // 768 agents are three environment batches of pairs, or one environment batch of threes.
    for (agents, env_batches) in [(2, 3), (3, 1)] {
        let trainer = Trainer::new(&[team(agents)], &settings(), Seed(5));
        assert_eq!(trainer.env_batches.len(), env_batches);
        let mut episodes = 0;
        for env_batch in &mut trainer.env_batches.clone() {
            env_batch.collect(&collection(&trainer));
            env_batch.collect(&Collection { first_step: 12, ..collection(&trainer) });
            episodes += env_batch.take_episodes().len();
        }
        // After twenty steps the first episode of each agent has ended, one way or the other.
        assert!(episodes >= 768, "{episodes} episodes of 768 agents, teams of {agents}");
    }
}

#[test]
fn runs_of_several_agents_resume_to_the_same_bits_on_any_number_of_threads() {
    let on_threads = |agents: usize, settings: &PpoSettings, threads: usize, parts: [u32; 2]| {
        let pool = rayon::ThreadPoolBuilder::new().num_threads(threads).build().expect("a pool");
        pool.install(|| {
            let mut trainer = Trainer::new(&[team(agents)], settings, Seed(5));
            (0..parts[0]).for_each(|_| drop(trainer.update()));
            let bytes = postcard::to_allocvec(&trainer.save()).expect("a state serialises");
            let state = postcard::from_bytes(&bytes).expect("and back");
            let mut trainer = Trainer::restore(&[team(agents)], settings, state).expect("it is the same run");
            (0..parts[1]).for_each(|_| drop(trainer.update()));
            trainer.save()
        })
    };
    for (agents, settings) in [(2, settings()), (2, mappo()), (3, mappo())] {
        let reference = on_threads(agents, &settings, 1, [3, 0]);
        assert_eq!(reference, on_threads(agents, &settings, 2, [1, 2]), "teams of {agents}");
        assert_eq!(reference, on_threads(agents, &settings, 7, [2, 1]), "teams of {agents}");
    }
}

#[test]
fn a_team_critic_reads_the_agent_itself_then_its_mates_in_a_circle() {
    let mut trainer = Trainer::new(&[team(3)], &mappo(), Seed(5));
    let own = OBSERVATION_LEN + PRIVILEGED_LEN;
    assert_eq!((trainer.actor().mlp().inputs(), trainer.critic().mlp().inputs()), (OBSERVATION_LEN, 3 * own));
    trainer.collect();
    let rollout = trainer.env_batches[0].rollout();
    // In an environment batch of 256 threes, the slices of a step are the first agents, the second ones, the third ones.
    for step in 0..12 {
        let block = |agent: usize, mate: usize| {
            let slice = rollout.slice(3 * step + agent);
            &slice.batch.values[mate * own * ENV_BATCH..(mate + 1) * own * ENV_BATCH]
        };
        for (agent, mate) in [(0, 1), (0, 2), (1, 1), (1, 2), (2, 1), (2, 2)] {
            assert_eq!(
                block(agent, mate),
                block((agent + mate) % 3, 0),
                "step {step}, agent {agent}, mate {mate}"
            );
        }
    }
}

#[test]
fn pairs_stand_beside_each_other_within_a_slice() {
    let mut trainer = Trainer::new(&[team(2)], &mappo(), Seed(5));
    let own = (OBSERVATION_LEN + PRIVILEGED_LEN) * ENV_BATCH;
    trainer.collect();
    let slice = trainer.env_batches[2].rollout().slice(7);
    let (own, mates) = slice.batch.values.split_at(own);
    for (own, mates) in own.chunks_exact(ENV_BATCH).zip(mates.chunks_exact(ENV_BATCH)) {
        let (first, second) = own.split_at(ENV_BATCH / 2);
        assert_eq!(mates, [second, first].concat());
    }
}

#[test]
fn a_critic_of_one_agent_reads_itself_whatever_its_scope() {
    let state = |settings: &PpoSettings| {
        let mut trainer = Trainer::new(&[task(true)], settings, Seed(4));
        trainer.update();
        trainer.save()
    };
    assert_eq!(state(&settings()), state(&PpoSettings { critic_scope: CriticScope::Team, ..settings() }));
}

#[test]
fn the_critic_of_another_scope_is_refused() {
    let state = Trainer::new(&[team(3)], &settings(), Seed(7)).save();
    let own = OBSERVATION_LEN + PRIVILEGED_LEN;
    assert_eq!(
        Trainer::restore(&[team(3)], &mappo(), state).expect_err("it must be refused").to_string(),
        format!("the saved critic has layers [{own}, 16, 1], the settings ask for [{}, 16, 1]", 3 * own)
    );
}

#[test]
fn the_scope_of_the_critic_changes_no_action_before_the_first_update() {
    let acted = |settings: &PpoSettings| {
        let mut trainer = Trainer::new(&[team(3)], settings, Seed(8));
        trainer.collect();
        let rollout = trainer.env_batches[0].rollout();
        (0..rollout.slices()).flat_map(|slice| rollout.slice(slice).actions.to_vec()).collect::<Vec<f32>>()
    };
    assert_eq!(acted(&settings()), acted(&mappo()));
}

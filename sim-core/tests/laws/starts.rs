//! Tests of starts and goals, on flat ground and on terrain, and of the score of a robot that stays at its start.

use sim_core::base::random::{Purpose, Stream};
use sim_core::evaluate::evaluate;
use sim_core::genotype::Genotype;
use sim_core::job::{JobSpec, Reference};
use sim_core::model::catalogue;
use sim_core::model::environment::Environment;
use sim_core::plan::Growth;
use sim_core::problem::Job;

const COVERAGE: &str = "{ kind = \"coverage\" }";

/// Small job of a shipped robot. `environment`: text of an environment file.
fn job(robot: &str, environment: &str, fitness: &str, more: &str) -> Result<Job, String> {
    let text = format!(
        "name = \"a\"\nrobot = \"{robot}\"\nenvironment = \"empty\"\ngaits = {{ count = 2, duration = 2.0 }}\n\
         fitness = {fitness}\noptimiser = {{ kind = \"ga\", population = 4, generations = 3 }}\n\
         finish = {{ kind = \"none\" }}\nplanner = {{ iterations = 20 }}\n{more}"
    );
    let spec: JobSpec = toml::from_str(&text).map_err(|e| e.to_string())?;
    let environment: Environment = toml::from_str(environment).map_err(|e| e.to_string())?;
    Job::new(JobSpec { environment: Reference::Inline(Box::new(environment)), ..spec }).map_err(|e| e.to_string())
}

/// Environment file of a map with the start at (−10, 0) and these blocks.
fn map(blocks: &str) -> String {
    format!("name = \"map\"\nsize = [40.0, 20.0]\nstart = {{ x = -10.0, y = 0.0, yaw = 0.3 }}\n{blocks}")
}

fn terrain(center: [f64; 2], size: [f64; 2], top: f64) -> String {
    format!("[[terrain]]\ncenter = {center:?}\nsize = {size:?}\ntop = {top:?}\n")
}

/// Height of the pivot at the start above the ground of the map, mu.
fn height(job: &Job) -> f64 {
    job.root().z
}

#[test]
fn start_on_terrain_is_as_high_as_the_terrain() {
    let flat = height(&job("quadropod", &map(""), COVERAGE, "physics = { engine = \"rapier\" }").unwrap());
    let plateau = terrain([-10.0, 0.0], [10.0, 10.0], 0.3);
    let halves = terrain([-15.0, 0.0], [10.0, 10.0], 0.3) + &terrain([-5.0, 0.0], [10.0, 10.0], 0.3);
    let steps = terrain([-10.0, 0.0], [16.0, 16.0], 0.3) + &terrain([-10.0, 0.0], [10.0, 10.0], 2.0);
    let beside = terrain([10.0, 0.0], [4.0, 4.0], 1.0);
    for (blocks, top) in [(plateau, 0.3), (halves, 0.3), (steps, 2.0), (beside, 0.0)] {
        let job = job("quadropod", &map(&blocks), COVERAGE, "").unwrap();
        assert_eq!(height(&job), flat + top, "{blocks}");
        let (start, _) = job.start_among_terrain();
        assert_eq!(start.pivot.translation.z, (flat + top) as f32);
        assert_eq!(Job::from_toml(&job.to_toml()).unwrap().digest(), job.digest());
    }
}

#[test]
fn robot_with_still_gaits_stays_on_its_plateau() {
    // All joints stay at 0, because μ = 0 gives a limit cycle of amplitude 0.
    let plateau = map(&terrain([-10.0, 0.0], [10.0, 10.0], 0.3));
    let stairs = map(&(terrain([-10.0, 0.0], [10.0, 20.0], 0.3) + &terrain([0.0, 0.0], [10.0, 20.0], 0.6)));
    for (map, engine) in [(&plateau, "rapier"), (&stairs, "rapier"), (&stairs, "lockstep")] {
        let more = format!("physics = {{ engine = \"{engine}\" }}");
        let fitness = "{ kind = \"coverage\", dimensions = 3, cell = 1.0 }";
        let job = job("quadropod", map, fitness, &more).unwrap();
        let genotype = Genotype::from(vec![0.0; job.space().longest()]);
        let mut trials =
            [sim_core::evaluate::Trial::new(&job, &genotype, 0.05, sim_core::evaluate::search_streams(&job, 0, 0))];
        sim_core::evaluate::grow(&job, &mut trials, &|| false).unwrap();
        let tree = trials[0].tree();
        assert!(tree.nodes.len() > 1);
        for node in &tree.nodes {
            assert!(tree.root().planar_distance(&node.place) < 0.3, "{engine}: {:?}", node.place);
            assert!((node.place.z - height(&job)).abs() < 0.05, "{engine}: {:?} of {}", node.place, height(&job));
        }
        let scored = evaluate(&job, 0, &[(0, genotype)], &|| false).unwrap();
        assert!(scored[0].score.is_some());
    }
}

#[test]
fn start_partly_on_terrain_is_refused() {
    for blocks in [
        terrain([-10.0, 0.0], [1.0, 1.0], 0.3),
        terrain([-10.0, 5.0], [10.0, 10.0], 0.3),
        terrain([-15.0, 0.0], [10.0, 10.0], 0.3) + &terrain([-5.0, 0.0], [10.0, 10.0], 0.4),
        terrain([-10.0, 0.0], [10.0, 10.0], 0.3) + &terrain([-10.0, 0.0], [1.0, 1.0], 1.0),
    ] {
        let error = job("quadropod", &map(&blocks), COVERAGE, "").map(|_| ()).unwrap_err();
        assert!(
            error.starts_with("the start at (-10, 0) lies where the robot touches environment.terrain["),
            "{error}"
        );
        assert!(error.ends_with("the whole robot must stand on flat ground, or over terrain of one height"), "{error}");
    }
    let blocked = terrain([-10.0, 0.0], [10.0, 10.0], 0.3)
        + "[[obstacle]]\ncenter = [-8.6, 0.4]\nsize = [0.5, 0.5]\nbase = 0.4\ntop = 1.0\n";
    let error = job("quadropod", &map(&blocked), COVERAGE, "").map(|_| ()).unwrap_err();
    assert!(error.ends_with("where the robot touches environment.obstacle[0]"), "{error}");
}

#[test]
fn tree_of_only_its_root_covers_nothing() {
    let starts = [(-10.0, 0.0), (0.0, 0.0), (-20.0, -10.0), (20.0, 10.0), (3.0, -2.5)];
    for (x, y) in starts {
        for robot in ["quadropod", "t-shape"] {
            let map = format!("name = \"map\"\nsize = [40.0, 20.0]\nstart = {{ x = {x:?}, y = {y:?} }}");
            for cell in [0.2, 0.25, 0.5, 1.0, 2.0, 2.5, 7.0] {
                for space in ["", ", dimensions = 3", ", dimensions = 3, height = 9.0"] {
                    let fitness = format!("{{ kind = \"coverage\", cell = {cell:?}{space} }}");
                    let job = job(robot, &map, &fitness, "").unwrap();
                    let growth = Growth::new(job.planner(), job.root(), Stream::new(1, Purpose::Planner, 0, 0, 0));
                    assert_eq!(growth.tree().nodes.len(), 1);
                    assert_eq!(
                        job.fitness().score(growth.tree(), &|_| [0.0; 3]),
                        0.0,
                        "{robot} at ({x}, {y}): {fitness}"
                    );
                }
            }
        }
    }
    let plateau = map(&terrain([-10.0, 0.0], [10.0, 10.0], 1.5));
    let job = job("lizard", &plateau, "{ kind = \"coverage\", cell = 0.5, dimensions = 3 }", "").unwrap();
    let growth = Growth::new(job.planner(), job.root(), Stream::new(1, Purpose::Planner, 0, 0, 0));
    assert_eq!(job.fitness().score(growth.tree(), &|_| [0.0; 3]), 0.0);
}

#[test]
fn every_robot_fits_at_every_shipped_goal() {
    let mut goals = 0;
    for entry in catalogue::environments() {
        let environment = Environment::from_toml(entry.toml).unwrap();
        let Some(goal) = environment.goal else { continue };
        goals += 1;
        for robot in catalogue::robots() {
            // A start at the goal is refused if the robot touches an obstacle there.
            for heading in 0..24 {
                let mut there = environment.clone();
                there.start.x = goal.x;
                there.start.y = goal.y;
                there.start.yaw = f64::from(heading) * std::f64::consts::TAU / 24.0;
                let text = toml::to_string(&there).unwrap();
                if heading > 0 && environment.obstacles.is_empty() {
                    continue;
                }
                job(robot.name, &text, COVERAGE, "")
                    .unwrap_or_else(|e| panic!("{} in {}: {e}", robot.name, entry.name));
            }
        }
        let job = job("lizard", entry.toml, COVERAGE, "").unwrap();
        assert_eq!(job.blocked_goal(), None, "{}", entry.name);
    }
    assert!(goals >= 6, "{goals}");
    for (name, distance) in [("empty-goal", 15.0), ("column-goal", 15.0), ("reuse-1", 30.0), ("reuse-3", 30.0)] {
        let entry = catalogue::find(catalogue::environments(), name).unwrap();
        let Environment { start, goal, .. } = Environment::from_toml(entry.toml).unwrap();
        let goal = goal.unwrap();
        assert_eq!(libm::hypot(goal.x - start.x, goal.y - start.y), distance, "{name}");
    }
}

#[test]
fn blocked_goal_names_its_obstacle() {
    let block =
        |x: f64, size: f64| format!("[[obstacle]]\ncenter = [{x:?}, 0.0]\nsize = [{size:?}, {size:?}]\ntop = 4.0\n");
    let far = block(-18.0, 1.0);
    let found = |blocks: &str| job("lizard", &map(&format!("goal = {{ x = 3.0, y = 0.0 }}\n{blocks}")), COVERAGE, "");
    for (blocks, blocked) in [
        (String::new(), None),
        (far.clone(), None),
        (block(1.4, 3.0), Some(0)),
        (far.clone() + &block(3.2, 0.1), Some(1)),
        (block(12.0, 4.0), None),
    ] {
        assert_eq!(found(&blocks).unwrap().blocked_goal(), blocked, "{blocks}");
    }
}

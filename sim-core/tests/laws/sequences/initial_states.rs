//! Text of initial states, errors of configurations, and random configurations.

use super::{FIG_2, source};
use proptest::prelude::*;
use sim_core::model::mtran::Angle;
use sim_core::model::mtran::{
    Configuration, InitialStateError, PENETRATION, Place, PlaceError, RandomError, parse, print, random,
};

#[test]
fn printed_figure_2_is_the_same_text() {
    assert_eq!(print(&parse(FIG_2).expect("valid")), FIG_2);
}

#[test]
fn lines_may_be_in_any_order_with_comments_and_spaces() {
    let text = "# Fig. 2\n\n ID 1 p ( -1 , 1 , 0 )z(-1,0,0) y(0,1,0)(0,0)#one\n\
                ID 2 p(-1,-1,0) z(-1,0,0) y(0,-1.0e0,0) (0, 0)\r\nID 0 p(0,0,0) z(0,1,0) y(-1,0,0) (-0, 0)";
    assert_eq!(parse(text).expect("valid"), parse(FIG_2).expect("valid"));
}

#[test]
fn text_errors_have_line_and_column() {
    let good = "ID 0 p(0,0,0) z(0,1,0) y(-1,0,0) (0, 0)\n";
    for (line, column, message) in [
        ("ID 1 p(0,0) z(0,1,0) y(1,0,0) (0, 0)", 11, "expected `,`"),
        ("ID 1 p(0,0,a) z(0,1,0) y(1,0,0) (0, 0)", 12, "expected a coordinate of p: a finite number"),
        ("ID 1 p(0,0,1e999) z(0,1,0) y(1,0,0) (0, 0)", 12, "finite"),
        ("ID 1 p(0,0,0) y(0,1,0) z(1,0,0) (0, 0)", 15, "expected `z`"),
        ("ID 1 p(0,0,0) z(0,1,0) y(1,0,0) (0, 45)", 37, "a multiple of 30 from -90 to 90"),
        ("ID 1 p(0,0,0) z(0,1,0) y(1,0,0) (0, 0) 5", 40, "expected the end of the line"),
        ("ID 0 p(0,0,0) z(0,1,0) y(1,0,0) (0, 0)", 4, "module 0 is already in line 1"),
        ("ID 2 p(0,0,0) z(0,1,0) y(1,0,0) (0, 0)", 1, "module 2 without module 1"),
        ("ID 64 p(0,0,0) z(0,1,0) y(1,0,0) (0, 0)", 4, "from 0 to 63"),
        ("module 1", 1, "expected `ID`"),
    ] {
        let error = parse(&format!("{good}{line}")).expect_err(line);
        assert_eq!((error.line, error.column), (2, column), "{line}: {error}");
        assert!(error.message.contains(message), "{line}: {error}");
    }
}

fn error_of(text: &str) -> PlaceError {
    match Configuration::of_text(text) {
        Err(InitialStateError::Place(error)) => error,
        other => panic!("{other:?} instead of an error of the places"),
    }
}

#[test]
fn axes_must_be_unit_and_perpendicular() {
    let error = error_of("ID 0 p(0,0,0) z(0,1.1,0) y(-1,0,0) (0, 0)");
    assert!(matches!(error, PlaceError::NotUnit { module: 0, axis: 'z', .. }), "{error}");
    let error = error_of("ID 0 p(0,0,0) z(0,1,0) y(0.6,0.8,0) (0, 0)");
    assert!(matches!(error, PlaceError::NotPerpendicular { module: 0, .. }), "{error}");
    let error = error_of("ID 0 p(0,0,1001) z(0,1,0) y(1,0,0) (0, 0)");
    assert!(matches!(error, PlaceError::Position { module: 0, .. }), "{error}");
}

#[test]
fn modules_must_not_overlap() {
    let text = |x: f64| format!("ID 0 p(0,0,0) z(0,0,1) y(0,1,0) (0, 0)\nID 1 p({x},1,0) z(0,0,1) y(0,-1,0) (0, 0)");
    match error_of(&text(0.9)) {
        PlaceError::Overlap { modules: [0, 1], depth } => assert!(depth > PENETRATION && depth < 0.11, "{depth}"),
        other => panic!("{other}"),
    }
    assert!(matches!(error_of(&text(1.0)), PlaceError::Disconnected { module: 1, meeting: None }));
}

#[test]
fn faces_of_one_kind_do_not_connect() {
    let error = error_of("ID 0 p(0,0,0) z(0,0,1) y(0,1,0) (0, 0)\nID 1 p(0,0,1) z(0,0,1) y(0,1,0) (0, 0)\n");
    assert_eq!(
        error.to_string(),
        "module 1 is not connected to module 0: module 0 part 0 face 1 and module 1 part 0 face 2 meet, \
         but one face must be active (part 1), the other passive (part 0)"
    );
}

#[test]
fn faces_turned_by_30_degrees_do_not_connect() {
    let (c, s) = (0.75_f64.sqrt(), 0.5);
    let text =
        |y: String, z: String| format!("ID 0 p(0,0,0) z(0,0,1) y(0,1,0) (0, 0)\nID 1 p(0,2,0) z({z}) y({y}) (0, 0)");
    let error = error_of(&text("0,1,0".into(), format!("{s},0,{c}")));
    assert!(matches!(error, PlaceError::Disconnected { module: 1, .. }), "{error}");
    assert!(Configuration::of_text(&text("0,1,0".into(), "-1,0,0".into())).is_ok());
}

#[test]
fn no_module_and_too_many_modules_are_refused() {
    assert_eq!(Configuration::of_places(&[]), Err(PlaceError::Count { count: 0 }));
    assert_eq!(random(0, &mut source(0)), Err(RandomError::Count { modules: 0 }));
    assert_eq!(random(65, &mut source(0)), Err(RandomError::Count { modules: 65 }));
}

#[test]
fn axes_do_not_turn_with_part_0() {
    let text = "ID 0 p(0,0,0) z(0,0,1) y(0,1,0) (90, 0)\nID 1 p(0,2,0) z(0,0,1) y(0,1,0) (0, 0)";
    let robot = Configuration::of_text(text).expect("the link keeps its direction");
    let flat_end = robot.face(super::port(0, 0, 0));
    assert!((flat_end.normal - nalgebra::Vector3::x()).norm() < 1e-15, "{:?}", flat_end.normal);
}

#[test]
fn random_configurations_are_valid() {
    for seed in 0..1000 {
        let modules = 2 + (seed % 7) as usize;
        let robot = random(modules, &mut source(seed)).expect("free places");
        assert_eq!(robot.len(), modules);
        assert_eq!(robot.lowest(), 0.0, "seed {seed}");
        assert!(robot.connections().len() >= modules - 1);
        for place in robot.places() {
            let is_lattice = |v: &f64| [-1.0, 0.0, 1.0].contains(v);
            assert!(place.z.iter().chain(&place.y).all(is_lattice), "seed {seed}: {place:?}");
            assert_eq!(place.angles, [Angle::default(); 2]);
        }
        let again = Configuration::of_text(&print(&robot.places())).expect("valid");
        assert_eq!(again, robot, "seed {seed}");
        assert_eq!(random(modules, &mut source(seed)), Ok(robot), "seed {seed}");
    }
}

#[test]
fn random_configurations_reach_all_orientations() {
    let mut seen = std::collections::BTreeSet::new();
    for seed in 0..1000 {
        let place = random(2, &mut source(seed)).expect("free places").places()[1];
        seen.insert(place.z.map(|v| v as i8).into_iter().chain(place.y.map(|v| v as i8)).collect::<Vec<_>>());
    }
    assert_eq!(seen.len(), 24);
}

#[test]
fn largest_random_configuration_is_found() {
    assert_eq!(random(64, &mut source(1)).map(|robot| robot.len()), Ok(64));
}

/// Returns places of finite numbers of any size, which need not be a configuration.
fn any_places() -> impl Strategy<Value = Vec<Place>> {
    let numbers = prop::array::uniform3(prop::num::f64::NORMAL | prop::num::f64::ZERO);
    let angle = || (-3..=3_i8).prop_map(|steps| Angle::of_steps(steps).expect("within ±90°"));
    let place = (numbers, numbers, numbers, angle(), angle());
    prop::collection::vec(place.prop_map(|(position, z, y, a, b)| Place { position, z, y, angles: [a, b] }), 0..5)
}

/// Returns a vector turned by `outer`, with its numbers rounded to 8 decimals.
fn turned(outer: &nalgebra::Rotation3<f64>, vector: [f64; 3]) -> [f64; 3] {
    (outer * nalgebra::Vector3::from(vector)).map(|c| (c * 1e8).round() / 1e8).into()
}

proptest! {
    #[test]
    fn printed_places_parse_to_the_same(places in any_places()) {
        prop_assert_eq!(parse(&print(&places)).expect("valid"), places);
    }

    #[test]
    fn text_that_is_no_initial_state_is_an_error_and_never_panics(text in "(ID|[pzy(),0-9. e#\n-]){0,60}") {
        let _ = Configuration::of_text(&text);
    }

    #[test]
    fn configuration_of_its_own_places_is_the_same(turn in prop::array::uniform3(-3.0..3.0_f64)) {
        let outer = nalgebra::Rotation3::new(nalgebra::Vector3::from(turn));
        let moved: Vec<Place> = parse(FIG_2).expect("valid").iter().map(|p| {
            let [position, z, y] = [p.position, p.z, p.y].map(|v| turned(&outer, v));
            Place { position, z, y, ..*p }
        }).collect();
        let robot = Configuration::of_places(&moved).expect("axes are near enough to unit");
        prop_assert_eq!(robot.connections().len(), 2);
        prop_assert_eq!(Configuration::of_places(&robot.places()).expect("valid"), robot);
    }
}

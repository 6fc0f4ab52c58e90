//! Help texts of all commands.

mod common;

use common::run;

#[test]
fn every_help_text_has_an_example() {
    let folder = tempfile::tempdir().unwrap();
    insta::assert_snapshot!("evogait", run(folder.path(), &["--help"]).success());
    let commands = [
        "run",
        "plan",
        "simulate",
        "submit",
        "watch",
        "list",
        "show",
        "pause",
        "resume",
        "restart",
        "evaluate",
        "cancel",
        "fetch",
        "workers",
        "demand",
        "health",
        "compare",
        "replay",
        "verify",
        "validate",
        "bench",
        "robot",
        "certs",
        "scenarios",
        "completions",
        "man",
    ];
    for command in commands {
        let help = run(folder.path(), &[command, "--help"]).success();
        assert!(help.contains("Example"), "the help of {command} must have an example");
        insta::assert_snapshot!(command, help);
    }
    for what in ["rollout", "evaluate", "fidelity", "fitness", "plan", "dispatch", "fleet", "reuse", "soundness"] {
        let help = run(folder.path(), &["bench", what, "--help"]).success();
        assert!(help.contains("Example"), "the help of bench {what} must have an example");
        insta::assert_snapshot!(format!("bench_{what}"), help);
    }
}

#[test]
fn missing_command_is_wrong_usage() {
    let folder = tempfile::tempdir().unwrap();
    let seen = run(folder.path(), &[]);
    assert_eq!(seen.code, 2);
    assert!(seen.err.contains("evogait run quadropod-empty"), "{}", seen.err);
}

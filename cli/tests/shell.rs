//! Completions and man pages.

mod common;

use common::run;

#[test]
fn completions_of_each_shell_name_the_commands() {
    let folder = tempfile::tempdir().unwrap();
    for shell in ["bash", "zsh", "fish", "elvish", "powershell"] {
        let script = run(folder.path(), &["completions", shell]).success();
        for word in ["simulate", "--friction", "scenarios"] {
            assert!(script.contains(word.trim_start_matches('-')), "the completions of {shell} must have {word}");
        }
    }
}

#[test]
fn unknown_shell_is_refused_with_those_allowed() {
    let folder = tempfile::tempdir().unwrap();
    let seen = run(folder.path(), &["completions", "csh"]);
    assert_eq!(seen.code, 2);
    assert!(seen.err.contains("csh") && seen.err.contains("bash, elvish, fish, powershell, zsh"), "{}", seen.err);
}

#[test]
fn man_pages_of_all_commands_are_written() {
    let folder = tempfile::tempdir().unwrap();
    assert!(run(folder.path(), &["man"]).success().contains(".TH evogait 1"));
    run(folder.path(), &["man", "--out", "pages/man1"]).success();
    for page in ["evogait.1", "evogait-run.1", "evogait-bench-rollout.1", "evogait-certs-init.1"] {
        let text = std::fs::read_to_string(folder.path().join("pages/man1").join(page)).expect(page);
        assert!(text.contains(".SH SYNOPSIS"), "{page}");
    }
}

#[test]
fn man_output_does_not_replace_a_file() {
    let folder = tempfile::tempdir().unwrap();
    std::fs::write(folder.path().join("man1"), "mine").unwrap();
    let seen = run(folder.path(), &["man", "--out", "man1"]);
    assert_eq!(seen.code, 1);
    assert!(seen.err.contains("man1"), "{}", seen.err);
    assert_eq!(std::fs::read_to_string(folder.path().join("man1")).unwrap(), "mine");
}

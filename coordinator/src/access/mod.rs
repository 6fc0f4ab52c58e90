//! Who may call what: tokens with roles, checked before a request is read.

mod guard;
mod pass;
mod rules;
mod tokens;

pub(crate) use guard::layer;
pub(crate) use pass::{Pass, Passing};
pub use rules::Role;
pub use tokens::{Access, TokensError};

use http::HeaderMap;
use http::header::AUTHORIZATION;
use rules::Rule;
use tonic::Status;

/// Whoever makes a call.
enum Caller {
    /// Where no tokens are asked for.
    Trusted,
    /// Of a method that is for everybody.
    Stranger,
    /// Of a token that is good for the call.
    Holder(Pass),
}

impl Caller {
    /// Whether the connection may stay.
    fn is_known(&self) -> bool {
        !matches!(self, Self::Stranger)
    }
}

/// Whether a call may be made, and by whom. Without `access` everybody may do everything.
fn admit(access: Option<&Access>, path: &str, headers: &HeaderMap) -> Result<Caller, Status> {
    let Some(access) = access else {
        return Ok(Caller::Trusted);
    };
    // What no rule names is for those who may do everything: a method that was forgotten is closed, not open.
    let rule = rules::of(path).unwrap_or(Rule::Only(Role::Admin));
    if rule == Rule::Anybody {
        return Ok(Caller::Stranger);
    }
    let Some(token) = bearer(headers) else {
        return Err(Status::unauthenticated(
            "this coordinator asks for a token: give one with --token-file FILE or in EVOGAIT_TOKEN",
        ));
    };
    let digest = tokens::digest(token);
    judge(access.role_of(&digest), rule, path)?;
    Ok(Caller::Holder(Pass::new(digest, rule, path, access.tokens())))
}

/// Whether a token with this role, if it is known at all, is good for a method.
fn judge(role: Option<Role>, rule: Rule, path: &str) -> Result<(), Status> {
    let Some(role) = role else {
        return Err(Status::unauthenticated(
            "the token is none of those that this coordinator knows: ask whoever runs it for a new one",
        ));
    };
    match rule {
        Rule::Only(needed) if role != needed && role != Role::Admin => Err(Status::permission_denied(format!(
            "{} needs a token with the role {needed}: this one has the role {role}",
            path.trim_start_matches('/')
        ))),
        _ => Ok(()),
    }
}

/// The one bearer token of a request.
fn bearer(headers: &HeaderMap) -> Option<&[u8]> {
    let mut all = headers.get_all(AUTHORIZATION).iter();
    let (Some(value), None) = (all.next(), all.next()) else {
        return None;
    };
    let (scheme, token) = value.as_bytes().split_at_checked(7)?;
    scheme.eq_ignore_ascii_case(b"bearer ").then_some(token)
}

#[cfg(test)]
mod tests {
    use super::*;
    use tonic::Code;

    const TOKENS: &str = "client client-token-0123456\nworker worker-token-0123456\nadmin admin-token-01234567\n";

    fn code(path: &str, values: &[&str]) -> Result<bool, Code> {
        let access = Access::parse(TOKENS).unwrap();
        let mut headers = HeaderMap::new();
        for value in values {
            headers.append(AUTHORIZATION, value.parse().unwrap());
        }
        admit(Some(&access), path, &headers).map(|caller| caller.is_known()).map_err(|status| status.code())
    }

    /// What each role may do of every method there is.
    #[test]
    fn every_method_has_a_rule_and_nobody_does_another_s_work() {
        for (path, rule) in rules::all() {
            assert!(rules::methods().contains(&path), "{path} is no method of any service: take its rule away");
            let of = |role: &str| code(&path, &[role]);
            let (client, worker) = (of("Bearer client-token-0123456"), of("Bearer worker-token-0123456"));
            let (nobody, stranger) = (code(&path, &[]), of("Bearer stranger-token-01234"));
            assert!(of("bearer admin-token-01234567").is_ok(), "{path}");
            let (expected_client, expected_worker, expected_nobody) = match rule {
                Rule::Anybody => (Ok(false), Ok(false), Ok(false)),
                Rule::Known => (Ok(true), Ok(true), Err(Code::Unauthenticated)),
                Rule::Only(role) => {
                    let may = |r| if r == role { Ok(true) } else { Err(Code::PermissionDenied) };
                    (may(Role::Client), may(Role::Worker), Err(Code::Unauthenticated))
                }
            };
            assert_eq!((client, worker), (expected_client, expected_worker), "{path}");
            assert_eq!((nobody, stranger), (expected_nobody, expected_nobody), "{path}");
        }
        for method in rules::methods() {
            assert!(rules::of(&method).is_some(), "{method} has no rule: say in rules.rs who may call it");
        }
    }

    #[test]
    fn a_worker_can_not_submit_and_a_client_can_not_complete() {
        let (submit, complete) = ("/evogait.v1.JobService/SubmitJob", "/evogait.v1.WorkerService/Complete");
        assert_eq!(code(submit, &["Bearer worker-token-0123456"]), Err(Code::PermissionDenied));
        assert_eq!(code(complete, &["Bearer client-token-0123456"]), Err(Code::PermissionDenied));
        assert_eq!(code(submit, &["Bearer client-token-0123456"]), Ok(true));
        assert_eq!(code(complete, &["Bearer worker-token-0123456"]), Ok(true));
        let access = Access::parse(TOKENS).unwrap();
        let headers = [(AUTHORIZATION, "Bearer worker-token-0123456".parse().unwrap())].into_iter().collect();
        let refused = admit(Some(&access), submit, &headers).err().expect("a worker can't submit");
        assert!(refused.message().contains("role client") && refused.message().contains("role worker"), "{refused}");
    }

    #[test]
    fn what_has_no_rule_is_closed() {
        for path in ["/evogait.v1.JobService/Later", "/evogait.v1.JobService/", "/", "", "/a/b/c"] {
            assert_eq!(code(path, &["Bearer client-token-0123456"]), Err(Code::PermissionDenied), "{path}");
            assert_eq!(code(path, &[]), Err(Code::Unauthenticated), "{path}");
        }
    }

    #[test]
    fn a_header_that_is_not_one_bearer_token_is_none() {
        let submit = "/evogait.v1.JobService/SubmitJob";
        let good = "Bearer client-token-0123456";
        for headers in [
            ["client-token-0123456"].as_slice(),
            &["Basic client-token-0123456"],
            &["Bearer"],
            &["Bearer "],
            &["Bearer client-token-012345"],
            &["Bearer client-token-01234567"],
            &["Bearer  client-token-0123456"],
            &[good, good],
        ] {
            assert_eq!(code(submit, headers), Err(Code::Unauthenticated), "{headers:?}");
        }
    }

    #[test]
    fn without_tokens_everybody_may_do_everything() {
        let caller = admit(None, "/evogait.v1.JobService/SubmitJob", &HeaderMap::new());
        assert!(matches!(caller, Ok(Caller::Trusted)));
    }
}

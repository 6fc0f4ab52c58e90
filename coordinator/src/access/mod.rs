//! Authorisation of calls: tokens with roles, checked before a request is read.

mod call_permit;
mod guard;
mod rules;
mod tokens;

pub(crate) use call_permit::{CallPermit, Passing};
pub(crate) use guard::layer;
pub use rules::Role;
pub use tokens::{Access, TokensError};

use http::HeaderMap;
use http::header::AUTHORIZATION;
use rules::Rule;
use tonic::Status;

/// Permission under which a call is made.
enum Caller {
    /// The coordinator requires no tokens.
    Trusted,
    /// The method requires no token.
    Anonymous,
    /// The token permits the call.
    Holder(CallPermit),
}

impl Caller {
    /// Returns true if the connection may stay open. A call without a token does not authenticate it.
    fn is_known(&self) -> bool {
        !matches!(self, Self::Anonymous)
    }
}

/// Returns the permission of a call, or refuses it. Without `access` every call is permitted.
fn admit(access: Option<&Access>, path: &str, headers: &HeaderMap) -> Result<Caller, Status> {
    let Some(access) = access else {
        return Ok(Caller::Trusted);
    };
    // A method without a rule is for admins only: forgetting a rule must not open a method.
    let rule = rules::of(path).unwrap_or(Rule::Only(Role::Admin));
    if rule == Rule::Anybody {
        return Ok(Caller::Anonymous);
    }
    let Some(token) = bearer(headers) else {
        return Err(Status::unauthenticated(
            "this coordinator requires a token: pass --token-file FILE or set EVOGAIT_TOKEN",
        ));
    };
    let digest = tokens::digest(token);
    judge(access.role_of(&digest), rule, path)?;
    Ok(Caller::Holder(CallPermit::new(digest, rule, path, access.tokens())))
}

/// Checks that a token with this role permits a method. `None` is an unknown token.
fn judge(role: Option<Role>, rule: Rule, path: &str) -> Result<(), Status> {
    let Some(role) = role else {
        return Err(Status::unauthenticated(
            "this coordinator does not accept the token: request a new one from its operator",
        ));
    };
    match rule {
        Rule::Only(needed) if role != needed && role != Role::Admin => Err(Status::permission_denied(format!(
            "{} requires a token with role {needed}: this token has role {role}",
            path.trim_start_matches('/')
        ))),
        _ => Ok(()),
    }
}

/// Returns the bearer token of a request; `None` without an authorization header or with several.
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

    /// Checks each role against every method of every service.
    #[test]
    fn every_method_admits_only_its_role() {
        for (path, rule) in rules::all() {
            assert!(rules::methods().contains(&path), "{path} is not a method of any service: remove its rule");
            let of = |role: &str| code(&path, &[role]);
            let (client, worker) = (of("Bearer client-token-0123456"), of("Bearer worker-token-0123456"));
            let (without, unknown) = (code(&path, &[]), of("Bearer unknown-token-01234"));
            assert!(of("bearer admin-token-01234567").is_ok(), "{path}");
            let (expected_client, expected_worker, expected_without) = match rule {
                Rule::Anybody => (Ok(false), Ok(false), Ok(false)),
                Rule::Known => (Ok(true), Ok(true), Err(Code::Unauthenticated)),
                Rule::Only(role) => {
                    let may = |r| if r == role { Ok(true) } else { Err(Code::PermissionDenied) };
                    (may(Role::Client), may(Role::Worker), Err(Code::Unauthenticated))
                }
            };
            assert_eq!((client, worker), (expected_client, expected_worker), "{path}");
            assert_eq!((without, unknown), (expected_without, expected_without), "{path}");
        }
        for method in rules::methods() {
            assert!(rules::of(&method).is_some(), "{method} has no rule: add one to rules.rs");
        }
    }

    #[test]
    fn submit_and_complete_require_their_own_roles() {
        let (submit, complete) = ("/evogait.v1.JobService/SubmitJob", "/evogait.v1.WorkerService/Complete");
        assert_eq!(code(submit, &["Bearer worker-token-0123456"]), Err(Code::PermissionDenied));
        assert_eq!(code(complete, &["Bearer client-token-0123456"]), Err(Code::PermissionDenied));
        assert_eq!(code(submit, &["Bearer client-token-0123456"]), Ok(true));
        assert_eq!(code(complete, &["Bearer worker-token-0123456"]), Ok(true));
        let access = Access::parse(TOKENS).unwrap();
        let headers = [(AUTHORIZATION, "Bearer worker-token-0123456".parse().unwrap())].into_iter().collect();
        let refused = admit(Some(&access), submit, &headers).err().expect("a worker can't submit a job");
        assert!(refused.message().contains("role client") && refused.message().contains("role worker"), "{refused}");
    }

    #[test]
    fn method_without_rule_is_for_admins_only() {
        for path in ["/evogait.v1.JobService/Later", "/evogait.v1.JobService/", "/", "", "/a/b/c"] {
            assert_eq!(code(path, &["Bearer client-token-0123456"]), Err(Code::PermissionDenied), "{path}");
            assert_eq!(code(path, &[]), Err(Code::Unauthenticated), "{path}");
        }
    }

    #[test]
    fn malformed_or_repeated_bearer_header_is_refused() {
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
    fn every_call_is_permitted_without_tokens() {
        let caller = admit(None, "/evogait.v1.JobService/SubmitJob", &HeaderMap::new());
        assert!(matches!(caller, Ok(Caller::Trusted)));
    }
}

//! Strict parser of OpenMetrics text. It also refuses faults that Prometheus tolerates.
//! <https://github.com/prometheus/OpenMetrics/blob/main/specification/OpenMetrics.md>

use std::collections::{BTreeMap, BTreeSet};

/// Scrape: values by series. A series is written as in the text: `name{label="value"}`.
pub type Series = BTreeMap<String, f64>;

/// Metric family that is being read.
#[derive(Default)]
struct Family {
    name: String,
    kind: String,
    unit: String,
    help: bool,
}

/// Reads a scrape. The error names the fault and the line.
pub fn parse(text: &str) -> Result<Series, String> {
    let body = text.strip_suffix("# EOF\n").ok_or("the text must end with \"# EOF\"")?;
    let (mut series, mut seen) = (Series::new(), BTreeSet::new());
    let mut family = Family::default();
    for line in body.lines() {
        let wrong = |why: &str| format!("{why}: {line}");
        if let Some(rest) = line.strip_prefix("# ") {
            let (what, rest) =
                rest.split_once(' ').ok_or_else(|| wrong("a comment needs a keyword, a name and a text"))?;
            let (name, text) = rest.split_once(' ').ok_or_else(|| wrong("a comment needs a name and a text"))?;
            if name != family.name {
                if !seen.insert(name.to_owned()) || !is_name(name) {
                    return Err(wrong("a family must have a valid name and must not be split"));
                }
                family = Family { name: name.to_owned(), ..Family::default() };
            }
            let fresh = match what {
                "HELP" => !std::mem::replace(&mut family.help, true) && text.len() > 3,
                "TYPE" => std::mem::replace(&mut family.kind, text.to_owned()).is_empty(),
                "UNIT" => {
                    name.ends_with(&format!("_{text}"))
                        && std::mem::replace(&mut family.unit, text.to_owned()).is_empty()
                }
                _ => false,
            };
            if !fresh {
                return Err(wrong("bad or repeated HELP, TYPE or UNIT"));
            }
            continue;
        }
        let (key, value) = line.rsplit_once(' ').ok_or_else(|| wrong("a sample needs a value"))?;
        let value: f64 = value.parse().map_err(|_| wrong("the value must be a number"))?;
        let (name, labels) = match key.split_once('{') {
            Some((name, labels)) => (name, labels.strip_suffix('}').ok_or_else(|| wrong("missing closing brace"))?),
            None => (key, ""),
        };
        let suffix =
            name.strip_prefix(&family.name).ok_or_else(|| wrong("a sample must follow its family's description"))?;
        let fits = match family.kind.as_str() {
            "counter" => suffix == "_total" && value >= 0.0,
            "gauge" => suffix.is_empty(),
            "histogram" => matches!(suffix, "_bucket" | "_sum" | "_count") && value >= 0.0,
            _ => false,
        };
        if !fits || !family.help {
            return Err(wrong("the suffix or value does not fit the type, or the family has no HELP"));
        }
        if !labels.is_empty() && !labels.split("\",").all(is_label) {
            return Err(wrong("bad label"));
        }
        if series.insert(key.to_owned(), value).is_some() {
            return Err(wrong("a series must appear once"));
        }
        if suffix == "_bucket" {
            bucket(&series, name, labels, value).map_err(wrong)?;
        }
        if suffix == "_count" && last_bucket(&series, &family.name, labels).is_some_and(|last| last != value) {
            return Err(wrong("_count differs from the last bucket"));
        }
    }
    Ok(series)
}

/// Returns the value of the last bucket if it came before.
fn last_bucket(series: &Series, family: &str, labels: &str) -> Option<f64> {
    let labels = if labels.is_empty() { String::new() } else { format!("{labels},") };
    series.get(&format!("{family}_bucket{{{labels}le=\"+Inf\"}}")).copied()
}

/// Checks that buckets are cumulative and that the last one equals `_count`.
fn bucket(series: &Series, name: &str, labels: &str, value: f64) -> Result<(), &'static str> {
    let bound = labels.split("le=\"").nth(1).and_then(|l| l.split('"').next()).ok_or("a bucket needs the label le")?;
    let bound: f64 = if bound == "+Inf" { f64::INFINITY } else { bound.parse().map_err(|_| "le must be a number")? };
    for (key, other) in series.range(format!("{name}{{")..).take_while(|(k, _)| k.starts_with(name)) {
        let other_bound = key.split("le=\"").nth(1).and_then(|l| l.split('"').next()).unwrap_or("");
        let other_bound: f64 = other_bound.replace("+Inf", "inf").parse().map_err(|_| "le must be a number")?;
        if other_bound < bound && *other > value {
            return Err("a bucket must not be smaller than the one below it");
        }
    }
    let count = series.get(&name.replace("_bucket", "_count"));
    if bound == f64::INFINITY && count.is_some_and(|count| *count != value) {
        return Err("the last bucket differs from _count");
    }
    Ok(())
}

fn is_name(name: &str) -> bool {
    let mut chars = name.chars();
    chars.next().is_some_and(|c| c.is_ascii_lowercase())
        && chars.all(|c| c.is_ascii_lowercase() || c.is_ascii_digit() || c == '_')
}

fn is_label(pair: &str) -> bool {
    let pair = pair.strip_suffix('"').unwrap_or(pair);
    pair.split_once("=\"").is_some_and(|(name, value)| is_name(name) && !value.contains(['"', '\n']))
}

#[cfg(test)]
mod tests {
    use super::parse;

    #[test]
    fn invalid_openmetrics_text_is_refused() {
        let good = "# HELP a_x Some x.\n# TYPE a_x counter\na_x_total{why=\"lost\",who=\"b\"} 3\na_x_total{why=\"y\"} 4\n# EOF\n";
        assert_eq!(parse(good).unwrap()["a_x_total{why=\"y\"}"], 4.0);
        let wrong = [
            good.replace("# EOF\n", ""),
            good.replace("_total", ""),
            good.replace("counter", "gauge"),
            good.replace(" 3", " three"),
            good.replace(" 3", " -3"),
            good.replace("why=\"y\"", "why=\"lost\",who=\"b\""),
            good.replace("why=\"y\"", "why=y"),
            good.replace("# HELP a_x Some x.\n", ""),
            good.replace("# TYPE", "# HELP"),
            good.replace("# EOF", "# HELP b Some b.\n# TYPE b gauge\nb 1\na_x_total 1\n# EOF"),
            good.replace("# EOF", "# HELP b Some b.\n# TYPE b gauge\nb 1\n# HELP a_x Some x.\n# EOF"),
        ];
        for text in wrong {
            assert!(parse(&text).is_err(), "{text}");
        }
        let histogram = "# HELP h Some h.\n# TYPE h histogram\nh_sum 3.5\nh_count 2\nh_bucket{le=\"1.0\"} 1\nh_bucket{le=\"+Inf\"} 2\n# EOF\n";
        assert_eq!(parse(histogram).unwrap().len(), 4);
        for (from, to) in [("\"} 2", "\"} 3"), ("\"} 1", "\"} 9"), ("le=\"1.0\"", "me=\"1.0\"")] {
            assert!(parse(&histogram.replace(from, to)).is_err(), "{from} {to}");
        }
    }
}

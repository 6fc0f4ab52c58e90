//! Settings as data: the table of a job file that chooses a component and gives its settings.
//!
//! A component lists its settings, each with unit, default and range. The lists determine how the table is read, which
//! keys and values are refused, and the resolved table with every setting written out.

use super::error::{Faults, Invalid, in_range, whole_in_range};
use super::registry::{Chosen, Component, Registered, expected};
use serde::de::{DeserializeSeed, Error as _, MapAccess, Visitor};
use serde::ser::SerializeStruct;
use serde::{Deserialize, Deserializer, Serialize, Serializer};
use std::fmt;
use std::marker::PhantomData;

/// Setting of a component.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Setting {
    /// Key in the table.
    pub name: &'static str,
    /// Unit; empty for a pure number.
    pub unit: &'static str,
    /// Type of its values.
    pub number: NumberType,
    /// Value if the file gives none. `None`: the setting is optional and has no default.
    pub default: Option<Number>,
    /// Least and greatest value. `None`: the component checks the value, because the range depends on other settings.
    pub range: Option<(f64, f64)>,
}

/// Type of a setting's values.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum NumberType {
    /// A whole number, 0 to 2³² − 1.
    Whole,
    /// A floating-point number.
    Real,
}

/// Value of a setting, in the setting's type.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum Number {
    /// Value of a setting with whole numbers.
    Whole(u32),
    /// Value of a setting with real numbers.
    Real(f64),
}

impl Setting {
    /// Creates a setting with whole numbers.
    pub const fn whole(name: &'static str, default: u32) -> Self {
        Self { name, unit: "", number: NumberType::Whole, default: Some(Number::Whole(default)), range: None }
    }

    /// Creates a setting with real numbers.
    pub const fn real(name: &'static str, unit: &'static str, default: f64) -> Self {
        Self { name, unit, number: NumberType::Real, default: Some(Number::Real(default)), range: None }
    }

    /// Creates an optional setting with whole numbers.
    pub const fn optional_whole(name: &'static str) -> Self {
        Self { name, unit: "", number: NumberType::Whole, default: None, range: None }
    }

    /// Creates an optional setting with real numbers.
    pub const fn optional_real(name: &'static str, unit: &'static str) -> Self {
        Self { name, unit, number: NumberType::Real, default: None, range: None }
    }

    /// Returns the same setting with the least and the greatest allowed value.
    pub const fn within(self, least: f64, greatest: f64) -> Self {
        Self { range: Some((least, greatest)), ..self }
    }

    /// Refuses a value out of range. `table` is the path of the table, for the message.
    fn check(&self, table: &str, value: Number) -> Result<(), Invalid> {
        let Some((least, greatest)) = self.range else { return Ok(()) };
        let field = format!("{table}.{}", self.name);
        match value {
            Number::Whole(value) => whole_in_range(field, value, (least as u64, greatest as u64), self.unit),
            Number::Real(value) => in_range(field, value, (least, greatest), self.unit),
        }
    }

    /// Converts a value that was read to this setting's type.
    fn convert(&self, value: Number) -> Result<Number, String> {
        match (self.number, value) {
            (NumberType::Real, Number::Whole(value)) => Ok(Number::Real(value.into())),
            (NumberType::Whole, Number::Real(value)) => {
                Err(format!("`{}` = {value} must be a whole number", self.name))
            }
            (_, value) => Ok(value),
        }
    }
}

/// Component that a table chooses and configures.
pub trait Configurable: Component {
    /// Returns its settings, in the order in which they are written out. This order is part of a job's identity.
    fn settings(&self) -> &'static [Setting];
}

/// Values of a component's settings: those that a file gives, and defaults for the others.
#[derive(Clone, Debug, PartialEq)]
pub struct Settings {
    known: &'static [Setting],
    /// One value per setting.
    values: Vec<Option<Number>>,
}

impl Settings {
    /// Returns the defaults.
    pub fn defaults(known: &'static [Setting]) -> Self {
        Self { known, values: known.iter().map(|setting| setting.default).collect() }
    }

    /// Returns the value of a setting with whole numbers.
    ///
    /// # Panics
    /// If the component has no such setting, or if the setting is optional and not given.
    pub fn whole(&self, setting: &Setting) -> u32 {
        self.optional_whole(setting).unwrap_or_else(|| panic!("setting {} has no value", setting.name))
    }

    /// Returns the value of an optional setting with whole numbers.
    ///
    /// # Panics
    /// If the component has no such setting.
    pub fn optional_whole(&self, setting: &Setting) -> Option<u32> {
        match self.value(setting) {
            None => None,
            Some(Number::Whole(value)) => Some(value),
            Some(Number::Real(value)) => panic!("setting {} is {value}, not a whole number", setting.name),
        }
    }

    /// Returns the value of a setting with real numbers.
    ///
    /// # Panics
    /// If the component has no such setting, or if the setting is optional and not given.
    pub fn real(&self, setting: &Setting) -> f64 {
        self.optional(setting).unwrap_or_else(|| panic!("setting {} has no value", setting.name))
    }

    /// Returns the value of an optional setting with real numbers.
    ///
    /// # Panics
    /// If the component has no such setting.
    pub fn optional(&self, setting: &Setting) -> Option<f64> {
        match self.value(setting) {
            None => None,
            Some(Number::Real(value)) => Some(value),
            Some(Number::Whole(value)) => panic!("setting {} is {value}, not a real number", setting.name),
        }
    }

    /// Returns true if the value of a setting is within its range or absent.
    pub fn fits(&self, setting: &Setting) -> bool {
        self.value(setting).is_none_or(|value| setting.check("", value).is_ok())
    }

    /// Refuses all values out of range. `table` is the path of the table, for the message.
    pub(crate) fn check(&self, table: &str) -> Result<(), Invalid> {
        let mut faults = Faults::default();
        for (setting, value) in self.known.iter().zip(&self.values) {
            faults.take(value.map_or(Ok(()), |value| setting.check(table, value)));
        }
        faults.end()
    }

    fn value(&self, setting: &Setting) -> Option<Number> {
        let place = self.known.iter().position(|known| known.name == setting.name);
        self.values[place.unwrap_or_else(|| panic!("the component has no setting {}", setting.name))]
    }
}

/// Table with a `kind`, which is the name of a component, and the settings of that component.
pub struct Table<T: ?Sized + 'static> {
    /// The component.
    pub kind: Chosen<T>,
    /// Values of its settings.
    pub settings: Settings,
}

impl<T: ?Sized> Clone for Table<T> {
    fn clone(&self) -> Self {
        Self { kind: self.kind, settings: self.settings.clone() }
    }
}

impl<T: Component + ?Sized> PartialEq for Table<T> {
    fn eq(&self, other: &Self) -> bool {
        self.kind == other.kind && self.settings == other.settings
    }
}

impl<T: Component + ?Sized> fmt::Debug for Table<T> {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.debug_struct("Table").field("kind", &self.kind).field("settings", &self.settings).finish()
    }
}

impl<T: Component + ?Sized> Serialize for Table<T> {
    fn serialize<S: Serializer>(&self, serializer: S) -> Result<S::Ok, S::Error> {
        let given = || self.settings.known.iter().zip(&self.settings.values).filter_map(|(s, v)| Some((s.name, (*v)?)));
        let mut table = serializer.serialize_struct("Table", 1 + given().count())?;
        table.serialize_field("kind", &self.kind)?;
        for (name, value) in given() {
            match value {
                Number::Whole(value) => table.serialize_field(name, &value)?,
                Number::Real(value) => table.serialize_field(name, &value)?,
            }
        }
        table.end()
    }
}

impl<'de, T: Configurable + Registered + ?Sized> Deserialize<'de> for Table<T> {
    fn deserialize<D: Deserializer<'de>>(deserializer: D) -> Result<Self, D::Error> {
        deserializer.deserialize_map(Reading(PhantomData))
    }
}

/// Key of the component's name.
const KIND: &str = "kind";

/// Visitor that reads a table. Each value is read as the type of its setting even before the kind is read, so that an
/// error names the value's line.
struct Reading<T: ?Sized>(PhantomData<T>);

impl<'de, T: Configurable + Registered + ?Sized> Visitor<'de> for Reading<T> {
    type Value = Table<T>;

    fn expecting(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.write_str("a table with a kind and its settings")
    }

    fn visit_map<A: MapAccess<'de>>(self, mut map: A) -> Result<Self::Value, A::Error> {
        let all = settings_of_all(&T::registry().all());
        let (mut kind, mut given) = (None, Vec::new());
        while let Some(key) = map.next_key_seed(Key(&all))? {
            match key {
                None => kind = Some(map.next_value::<Chosen<T>>()?),
                Some(setting) => given.push((setting.name, map.next_value_seed(setting.number)?)),
            }
        }
        let kind = kind.ok_or_else(|| A::Error::missing_field(KIND))?;
        only_settings_of(kind.0, &all, &given).map_err(A::Error::custom)?;
        let mut settings = Settings::defaults(kind.0.settings());
        for (setting, value) in settings.known.iter().zip(&mut settings.values) {
            if let Some((_, found)) = given.iter().find(|(name, _)| *name == setting.name) {
                *value = Some(setting.convert(*found).map_err(A::Error::custom)?);
            }
        }
        Ok(Table { kind, settings })
    }
}

/// Returns the settings of all components, each name once. Settings that all components have come first. If components
/// give one name different types, it is read as a real number.
fn settings_of_all<T: Configurable + ?Sized>(components: &[&'static T]) -> Vec<Setting> {
    let has = |component: &&'static T, name: &str| component.settings().iter().any(|s| s.name == name);
    let mut all: Vec<Setting> = Vec::new();
    for setting in components.iter().flat_map(|component| component.settings()) {
        match all.iter_mut().find(|known| known.name == setting.name) {
            None => all.push(*setting),
            Some(known) if setting.number == NumberType::Real => known.number = NumberType::Real,
            Some(_) => {}
        }
    }
    all.sort_by_key(|setting| !components.iter().all(|component| has(component, setting.name)));
    all
}

/// Refuses settings that the kind does not have.
fn only_settings_of<T: Configurable + ?Sized>(
    kind: &T,
    all: &[Setting],
    given: &[(&'static str, Number)],
) -> Result<(), String> {
    let has = |name: &str| kind.settings().iter().any(|own| own.name == name);
    let is_given = |setting: &&Setting| given.iter().any(|(name, _)| *name == setting.name);
    let Some(stray) = all.iter().filter(is_given).find(|setting| !has(setting.name)) else { return Ok(()) };
    let own: Vec<String> = all.iter().filter(|s| has(s.name)).map(|s| format!("`{}`", s.name)).collect();
    let own = if own.is_empty() { "no settings".to_owned() } else { own.join(", ") };
    Err(format!("`{}` is no setting of kind = \"{}\", which has {own}", stray.name, kind.name()))
}

/// Reader of a key: `None` for the kind, otherwise one of the settings.
struct Key<'a>(&'a [Setting]);

impl<'de, 'a> DeserializeSeed<'de> for Key<'a> {
    type Value = Option<&'a Setting>;

    fn deserialize<D: Deserializer<'de>>(self, deserializer: D) -> Result<Self::Value, D::Error> {
        deserializer.deserialize_identifier(self)
    }
}

impl<'a> Visitor<'_> for Key<'a> {
    type Value = Option<&'a Setting>;

    fn expecting(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.write_str("the name of a setting")
    }

    fn visit_str<E: serde::de::Error>(self, name: &str) -> Result<Self::Value, E> {
        if name == KIND {
            return Ok(None);
        }
        self.0.iter().find(|setting| setting.name == name).map(Some).ok_or_else(|| {
            let known: Vec<&str> = [KIND].into_iter().chain(self.0.iter().map(|setting| setting.name)).collect();
            // Same wording as serde's own error.
            E::custom(format!("unknown field `{name}`, {}", expected(&known)))
        })
    }
}

impl<'de> DeserializeSeed<'de> for NumberType {
    type Value = Number;

    fn deserialize<D: Deserializer<'de>>(self, deserializer: D) -> Result<Number, D::Error> {
        match self {
            Self::Whole => u32::deserialize(deserializer).map(Number::Whole),
            Self::Real => f64::deserialize(deserializer).map(Number::Real),
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::base::registry::Registry;

    /// Kind with a name and settings.
    struct Kind(&'static str, &'static [Setting]);

    const STEPS: Setting = Setting::whole("steps", 5).within(1.0, 9.0);
    const GAIN: Setting = Setting::real("gain", "1/s", 0.5).within(0.0, 1.0);
    const LIMIT: Setting = Setting::optional_real("limit", "mu");
    const COUNT: Setting = Setting::optional_whole("count").within(1.0, 9.0);

    static KINDS: Registry<Kind> = Registry::new(&[
        &Kind("one", &[GAIN, STEPS]),
        &Kind("other", &[STEPS, LIMIT, Setting::whole("gain", 1), COUNT]),
    ]);

    impl Component for Kind {
        fn name(&self) -> &'static str {
            self.0
        }
    }

    impl Registered for Kind {
        fn registry() -> &'static Registry<Self> {
            &KINDS
        }
    }

    impl Configurable for Kind {
        fn settings(&self) -> &'static [Setting] {
            self.1
        }
    }

    fn read(text: &str) -> Result<Table<Kind>, String> {
        toml::from_str(text).map_err(|e| e.to_string())
    }

    #[test]
    fn resolved_table_lists_all_settings_in_order() {
        let written = |text| toml::to_string(&read(text).unwrap()).unwrap();
        assert_eq!(written("kind = 'one'"), "kind = \"one\"\ngain = 0.5\nsteps = 5\n");
        assert_eq!(written("steps = 7\ngain = 1\nkind = 'one'"), "kind = \"one\"\ngain = 1.0\nsteps = 7\n");
        assert_eq!(written("kind = 'other'\nlimit = 2.5"), "kind = \"other\"\nsteps = 5\nlimit = 2.5\ngain = 1\n");
        let table = read("kind = 'other'").unwrap();
        assert_eq!((table.settings.whole(&STEPS), table.settings.optional(&LIMIT)), (5, None));
        assert_eq!(table.settings.optional_whole(&COUNT), None);
        assert_eq!(read("kind = 'other'\ncount = 3").unwrap().settings.optional_whole(&COUNT), Some(3));
    }

    #[test]
    fn wrong_keys_and_values_are_refused_with_their_line() {
        for (text, line, says) in [
            (
                "kind = 'one'\nstep = 1",
                2,
                "unknown field `step`, expected one of `kind`, `gain`, `steps`, `limit`, `count`",
            ),
            ("steps = -1\nkind = 'one'", 1, "expected u32"),
            ("kind = 'one'\n\ngain = 'much'", 3, "expected f64"),
            ("kind = 'two'", 1, "unknown variant `two`, expected `one` or `other`"),
            ("kind = 'one'\nlimit = 1.0", 1, "`limit` is no setting of kind = \"one\", which has `gain`, `steps`"),
            ("kind = 'other'\ngain = 1.5", 1, "`gain` = 1.5 must be a whole number"),
            ("steps = 1", 1, "missing field `kind`"),
        ] {
            let said = read(text).unwrap_err();
            assert!(said.contains(says) && said.contains(&format!("line {line},")), "{text}: {said}");
        }
    }

    #[test]
    fn values_out_of_range_are_refused_together() {
        let said = |text| read(text).unwrap().settings.check("table").unwrap_err().to_string();
        let range = "is out of range: allowed is";
        assert_eq!(said("kind = 'one'\nsteps = 10"), format!("table.steps = 10 {range} 1 to 9"));
        assert_eq!(said("kind = 'one'\ngain = nan"), format!("table.gain = NaN {range} 0 to 1 1/s"));
        assert!(said("kind = 'one'\ngain = 2.0\nsteps = 0").starts_with("2 faults"));
        let table = read("kind = 'one'\ngain = 2.0").unwrap();
        assert!(!table.settings.fits(&GAIN) && table.settings.fits(&STEPS));
        assert_eq!(read("kind = 'other'\nlimit = inf").unwrap().settings.check("table"), Ok(()));
    }
}

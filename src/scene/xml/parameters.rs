//! `$name` in attributes: `<default name="" value=""/>` in the file, `-D name=value` from outside.

use crate::scene::error::{Location, SceneError};

/// A substituted attribute may not grow beyond this many bytes. The longest honest one, a matrix, has a few hundred;
/// without a limit thirty `<default>`s that each repeat the one before twice make a gigabyte.
const MAX_ATTRIBUTE_BYTES: usize = 1 << 16;

/// A named value.
#[derive(Debug)]
struct Parameter {
    name: String,
    value: String,
    from_outside: bool,
    is_used: bool,
}

/// The parameters known so far, longest name first, so that `$resx` is not read as `$res` and an `x`.
#[derive(Debug, Default)]
pub(super) struct Parameters {
    parameters: Vec<Parameter>,
}

impl Parameters {
    /// Definitions from outside; they win over every `<default>`, and the last of a name wins.
    pub(super) fn new(definitions: &[(String, String)]) -> Self {
        let mut parameters = Self::default();
        for (name, value) in definitions.iter().rev() {
            parameters.add(name, value, true);
        }
        parameters
    }

    /// A `<default>`: has no effect on a parameter that is there already.
    pub(super) fn set_default(&mut self, name: &str, value: &str) {
        self.add(name, value, false);
    }

    fn add(&mut self, name: &str, value: &str, from_outside: bool) {
        if self.parameters.iter().all(|parameter| parameter.name != name) {
            let (name, value) = (name.to_owned(), value.to_owned());
            self.parameters.push(Parameter { name, value, from_outside, is_used: false });
            self.parameters.sort_by_key(|parameter| std::cmp::Reverse(parameter.name.len()));
        }
    }

    /// `text` with every `$name` replaced by its value; `\$` is a dollar sign. Values are not searched again.
    ///
    /// # Errors
    /// [`SceneError::Unknown`] for a name that is not defined (yet), [`SceneError::Limit`] when the text grows too long.
    pub(super) fn substitute(
        &mut self,
        text: &str,
        location: &Location,
    ) -> Result<String, SceneError> {
        let mut result = String::with_capacity(text.len());
        let mut rest = text;
        while let Some(dollar) = rest.find('$') {
            let (before, after) = (&rest[..dollar], &rest[dollar + 1..]);
            if let Some(before) = before.strip_suffix('\\') {
                result.push_str(before);
                result.push('$');
                rest = after;
                continue;
            }
            result.push_str(before);
            match self.parameters.iter_mut().find(|parameter| after.starts_with(&parameter.name)) {
                Some(parameter) => {
                    parameter.is_used = true;
                    result.push_str(&parameter.value);
                    rest = &after[parameter.name.len()..];
                }
                None => {
                    let end = after.find(|letter: char| !letter.is_alphanumeric() && letter != '_');
                    let name = &after[..end.unwrap_or(after.len())];
                    let known = self.parameters.iter().map(|parameter| &parameter.name);
                    return Err(SceneError::unknown(
                        location,
                        "parameter",
                        format!("${name}"),
                        known,
                    ));
                }
            }
            if result.len() > MAX_ATTRIBUTE_BYTES {
                let what = "an attribute is too long after substitution".to_owned();
                return Err(SceneError::Limit {
                    location: location.clone(),
                    what,
                    limit: MAX_ATTRIBUTE_BYTES as u64,
                });
            }
        }
        result.push_str(rest);
        Ok(result)
    }

    /// # Errors
    /// [`SceneError::UnusedDefinition`] for a definition from outside that nothing asked for: most likely misspelt.
    pub(super) fn check_all_used(&self) -> Result<(), SceneError> {
        match self.parameters.iter().find(|parameter| parameter.from_outside && !parameter.is_used)
        {
            Some(unused) => {
                let used = self.parameters.iter().filter(|parameter| parameter.is_used);
                let mut known: Vec<String> = used.map(|parameter| parameter.name.clone()).collect();
                known.sort_unstable();
                Err(SceneError::UnusedDefinition { name: unused.name.clone(), known })
            }
            None => Ok(()),
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use std::path::Path;

    fn here() -> Location {
        Location { file: Path::new("scene.xml").into(), line: 1, column: 1 }
    }

    fn parameters(definitions: &[(&str, &str)]) -> Parameters {
        let owned: Vec<_> = definitions
            .iter()
            .map(|(name, value)| ((*name).to_owned(), (*value).to_owned()))
            .collect();
        Parameters::new(&owned)
    }

    #[test]
    fn the_longest_name_is_substituted() {
        for order in [[("res", "1"), ("resx", "2")], [("resx", "2"), ("res", "1")]] {
            let mut parameters = parameters(&order);
            assert_eq!(parameters.substitute("$resx $res$resy", &here()).unwrap(), "2 11y");
        }
    }

    #[test]
    fn a_definition_wins_over_a_default_and_the_last_over_the_first() {
        let mut parameters = parameters(&[("spp", "4"), ("spp", "8")]);
        parameters.set_default("spp", "16");
        assert_eq!(parameters.substitute("$spp", &here()).unwrap(), "8");
    }

    #[test]
    fn an_escaped_dollar_stays() {
        assert_eq!(parameters(&[]).substitute(r"a\$b", &here()).unwrap(), "a$b");
    }

    #[test]
    fn an_undefined_parameter_is_an_error_that_names_it() {
        let error = parameters(&[("width", "1")])
            .substitute("x $widht+1", &here())
            .unwrap_err()
            .to_string();
        assert!(error.contains("\"$widht\"") && error.contains("width"), "{error}");
    }

    #[test]
    fn an_unused_definition_is_an_error_that_names_the_used_ones() {
        let mut parameters = parameters(&[("ssp", "4")]);
        parameters.set_default("spp", "16");
        parameters.set_default("other", "1");
        parameters.substitute("$spp", &here()).unwrap();
        let error = parameters.check_all_used().unwrap_err().to_string();
        assert!(
            error.contains("ssp") && error.contains("\"spp\"") && !error.contains("other"),
            "{error}"
        );
    }

    #[test]
    fn parameters_that_double_each_other_are_stopped() {
        let mut parameters = parameters(&[]);
        parameters.set_default("a0", "0123456789");
        let mut result = Ok(String::new());
        for i in 0..40 {
            result = parameters.substitute(&format!("$a{i}$a{i}"), &here());
            match &result {
                Ok(value) => parameters.set_default(&format!("a{}", i + 1), value),
                Err(_) => break,
            }
        }
        assert!(matches!(result, Err(SceneError::Limit { .. })), "{result:?}");
    }
}

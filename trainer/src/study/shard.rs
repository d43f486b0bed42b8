//! Shards: the seeds of a study for one of many machines.

use super::plan::Seeds;
use std::fmt;
use std::str::FromStr;

/// Shard `index` of `count`, which takes every `count`-th seed, so that a study that is cut
/// short has the first seeds of every shard. Indices count from 1.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Shard {
    index: u64,
    count: u64,
}

/// The reason why there is no shard.
#[derive(Clone, Debug, PartialEq, Eq, thiserror::Error)]
pub enum ShardError {
    /// The text is no shard.
    #[error("'{0}' is not I/N, such as 1/4, nor auto, nor auto/N")]
    Form(String),
    /// The index is out of range.
    #[error("{index}/{count}: shards count from 1, so that they are 1/{count} to {count}/{count}")]
    Index {
        /// Index as given.
        index: u64,
        /// Number of shards.
        count: u64,
    },
    /// No environment variable names the shard.
    #[error(
        "auto: neither SLURM_ARRAY_TASK_ID nor JOB_COMPLETION_INDEX is set, so this is neither \
         a task of a Slurm job array (sbatch --array=0-7) nor a pod of a Kubernetes indexed job \
         (completionMode: Indexed); name the shard: I/N"
    )]
    Nowhere,
    /// Both schedulers' variables are set.
    #[error("auto: both SLURM_ARRAY_TASK_ID and JOB_COMPLETION_INDEX are set; name the shard: I/N")]
    Both,
    /// A required variable is not set.
    #[error("auto: {0} is not set, though SLURM_ARRAY_TASK_ID is; name the shard: I/N")]
    Unset(&'static str),
    /// A variable is not a number.
    #[error("auto: {name} is '{value}', not a whole number; name the shard: I/N")]
    Value {
        /// Name of the variable.
        name: &'static str,
        /// Value of the variable.
        value: String,
    },
    /// The job array has gaps.
    #[error(
        "auto: the Slurm job array has {count} tasks from {min} to {max} by {step}, which leaves \
         gaps; submit all of it (sbatch --array=0-7), or say auto/N with N all of its tasks, \
         counted from 0"
    )]
    Gaps {
        /// `SLURM_ARRAY_TASK_COUNT`.
        count: u64,
        /// `SLURM_ARRAY_TASK_MIN`.
        min: u64,
        /// `SLURM_ARRAY_TASK_MAX`.
        max: u64,
        /// `SLURM_ARRAY_TASK_STEP`.
        step: u64,
    },
    /// Kubernetes does not state the number of pods.
    #[error(
        "auto: JOB_COMPLETION_INDEX is {0}, but of how many is in no variable; \
         say auto/N with N the job's completions"
    )]
    Count(u64),
    /// An index is past the count.
    #[error(
        "auto/{count}: {name} is {index}, but with {count} shards it counts from 0 to {}; \
         correct N or the array", count - 1
    )]
    Past {
        /// Name of the variable.
        name: &'static str,
        /// Value of the variable.
        index: u64,
        /// Number of shards.
        count: u64,
    },
}

const TASK: &str = "SLURM_ARRAY_TASK_ID";
const POD: &str = "JOB_COMPLETION_INDEX";

impl Shard {
    /// The shard with all seeds.
    pub const ALL: Self = Self { index: 1, count: 1 };

    /// Returns shard `index`, from 1, of `count`.
    ///
    /// # Errors
    /// [`ShardError::Index`] when the index is out of range.
    pub fn new(index: u64, count: u64) -> Result<Self, ShardError> {
        if (1..=count).contains(&index) {
            Ok(Self { index, count })
        } else {
            Err(ShardError::Index { index, count })
        }
    }

    /// Whether the shard has all seeds.
    #[must_use]
    pub fn is_all(self) -> bool {
        self.count == 1
    }

    /// Returns its seeds, ascending; none where there are fewer seeds than shards.
    pub fn of(self, seeds: Seeds) -> impl Iterator<Item = u64> {
        // There are at most a million seeds; a larger count leaves each shard one seed.
        let step = usize::try_from(self.count).unwrap_or(usize::MAX);
        let skip = usize::try_from(self.index - 1).unwrap_or(usize::MAX);
        seeds.iter().skip(skip).step_by(step)
    }
}

impl fmt::Display for Shard {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        write!(f, "{}/{}", self.index, self.count)
    }
}

/// A shard as requested by the user.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Request {
    /// A shard by number.
    Named(Shard),
    /// The shard that the environment names, with its count where it is given.
    Auto(Option<u64>),
}

impl FromStr for Request {
    type Err = ShardError;

    fn from_str(text: &str) -> Result<Self, ShardError> {
        let form = || ShardError::Form(text.into());
        let number = |digits: &str| digits.parse::<u64>().map_err(|_| form());
        match text.split_once('/') {
            None if text == "auto" => Ok(Self::Auto(None)),
            None => Err(form()),
            Some(("auto", count)) => match number(count)? {
                0 => Err(form()),
                count => Ok(Self::Auto(Some(count))),
            },
            Some((index, count)) => Ok(Self::Named(Shard::new(number(index)?, number(count)?)?)),
        }
    }
}

impl Request {
    /// Returns the shard; `variable` looks up an environment variable.
    ///
    /// # Errors
    /// [`ShardError`] when a variable is missing or contradicts another.
    pub fn resolve(self, variable: impl Fn(&str) -> Option<String>) -> Result<Shard, ShardError> {
        let given = match self {
            Self::Named(shard) => return Ok(shard),
            Self::Auto(count) => count,
        };
        let number = |name: &'static str| {
            let parse = |value: String| {
                value.trim().parse::<u64>().map_err(|_| ShardError::Value { name, value })
            };
            variable(name).map(parse).transpose()
        };
        let (name, index) = match (number(TASK)?, number(POD)?) {
            (Some(_), Some(_)) => return Err(ShardError::Both),
            (None, None) => return Err(ShardError::Nowhere),
            (Some(task), None) if given.is_none() => {
                let need = |name| number(name)?.ok_or(ShardError::Unset(name));
                return in_array(
                    task,
                    need("SLURM_ARRAY_TASK_COUNT")?,
                    need("SLURM_ARRAY_TASK_MIN")?,
                    need("SLURM_ARRAY_TASK_MAX")?,
                    // Old versions of Slurm do not set it where it is 1.
                    number("SLURM_ARRAY_TASK_STEP")?.unwrap_or(1),
                );
            }
            (Some(task), None) => (TASK, task),
            (None, Some(pod)) => (POD, pod),
        };
        let count = given.ok_or(ShardError::Count(index))?;
        if index >= count {
            return Err(ShardError::Past { name, index, count });
        }
        Shard::new(index + 1, count)
    }
}

/// Returns the shard of a task in a job array without gaps, whatever its first index and step.
fn in_array(task: u64, count: u64, min: u64, max: u64, step: u64) -> Result<Shard, ShardError> {
    let gaps = ShardError::Gaps { count, min, max, step };
    let even = step > 0
        && (min..=max).contains(&task)
        && (task - min).is_multiple_of(step)
        && (max - min) / step + 1 == count;
    if even { Shard::new((task - min) / step + 1, count) } else { Err(gaps) }
}

#[cfg(test)]
mod tests {
    use super::{Request, Shard};
    use crate::study::plan::Seeds;

    fn resolve(request: &str, environment: &[(&str, &str)]) -> Result<String, String> {
        let find = |name: &str| {
            environment.iter().find(|(key, _)| *key == name).map(|(_, value)| (*value).to_string())
        };
        let request: Request = request.parse().map_err(|e: super::ShardError| e.to_string())?;
        request.resolve(find).map(|shard| shard.to_string()).map_err(|e| e.to_string())
    }

    #[test]
    fn every_seed_is_in_exactly_one_shard() {
        for first in [0, 5] {
            for seeds in 1..=12_u64 {
                let range: Seeds = format!("{first}..{}", first + seeds).parse().unwrap();
                for count in 1..=15 {
                    let shards = (1..=count).map(|i| Shard::new(i, count).unwrap());
                    let parts: Vec<Vec<u64>> = shards.map(|s| s.of(range).collect()).collect();
                    let mut all = parts.concat();
                    all.sort_unstable();
                    assert_eq!(all, range.iter().collect::<Vec<_>>());
                    let sizes = || parts.iter().map(Vec::len);
                    assert!(sizes().max().unwrap() - sizes().min().unwrap() <= 1, "{parts:?}");
                }
            }
        }
        let all: Vec<u64> = Shard::ALL.of("2..5".parse().unwrap()).collect();
        assert_eq!(all, [2, 3, 4]);
    }

    #[test]
    fn parses_a_shard_by_number_and_refuses_others() {
        assert_eq!(resolve("2/3", &[]).unwrap(), "2/3");
        for (text, expected) in [
            ("0/4", "0/4: shards count from 1, so that they are 1/4 to 4/4"),
            ("5/4", "5/4: shards count from 1"),
            ("1/0", "1/0: shards count"),
            ("2", "'2' is not I/N"),
            ("a/2", "'a/2' is not I/N"),
            ("auto/0", "'auto/0' is not I/N"),
            ("auto/", "'auto/' is not I/N"),
        ] {
            assert!(resolve(text, &[]).unwrap_err().starts_with(expected), "{text}");
        }
    }

    fn array<'a>(
        id: &'a str,
        min: &'a str,
        max: &'a str,
        count: &'a str,
    ) -> [(&'a str, &'a str); 4] {
        [
            ("SLURM_ARRAY_TASK_ID", id),
            ("SLURM_ARRAY_TASK_MIN", min),
            ("SLURM_ARRAY_TASK_MAX", max),
            ("SLURM_ARRAY_TASK_COUNT", count),
        ]
    }

    #[test]
    fn takes_the_shard_from_a_slurm_job_array() {
        assert_eq!(resolve("auto", &array("0", "0", "3", "4")).unwrap(), "1/4");
        assert_eq!(resolve("auto", &array("3", "0", "3", "4")).unwrap(), "4/4");
        assert_eq!(resolve("auto", &array("1", "1", "3", "3")).unwrap(), "1/3");
        let by_five = [&array("20", "10", "20", "3")[..], &[("SLURM_ARRAY_TASK_STEP", "5")]];
        assert_eq!(resolve("auto", &by_five.concat()).unwrap(), "3/3");
        // A resubmitted task of an array needs a given count.
        assert_eq!(resolve("auto/4", &array("2", "2", "2", "1")).unwrap(), "3/4");
        for (request, environment, expected) in [
            ("auto", &array("5", "1", "7", "3")[..], "has 3 tasks from 1 to 7 by 1"),
            ("auto", &array("0", "0", "3", "4")[..1], "SLURM_ARRAY_TASK_COUNT is not set"),
            ("auto", &array("x", "0", "3", "4")[..], "SLURM_ARRAY_TASK_ID is 'x'"),
            ("auto", &array("9", "0", "3", "4")[..], "leaves gaps"),
            ("auto/4", &array("4", "1", "4", "4")[..], "is 4, but with 4 shards it counts from 0"),
        ] {
            let error = resolve(request, environment).unwrap_err();
            assert!(error.contains(expected), "{error}");
        }
    }

    #[test]
    fn takes_the_index_from_kubernetes_and_needs_the_count() {
        let pod = [("JOB_COMPLETION_INDEX", "7")];
        assert_eq!(resolve("auto/8", &pod).unwrap(), "8/8");
        let error = resolve("auto", &pod).unwrap_err();
        assert!(error.contains("JOB_COMPLETION_INDEX is 7") && error.contains("auto/N"), "{error}");
        assert!(resolve("auto/7", &pod).unwrap_err().contains("from 0 to 6"));
        assert!(resolve("auto", &[]).unwrap_err().contains("neither"));
        let both = [&array("0", "0", "3", "4")[..], &pod].concat();
        assert!(resolve("auto/8", &both).unwrap_err().contains("both"));
    }
}

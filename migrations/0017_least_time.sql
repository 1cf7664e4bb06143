-- The least time that a worker must have left to be given a job, in microseconds (see forecasts.rs). Workers whose time
-- is not limited take every job, and so do all workers those that waited when this column came.
alter table jobs add column least_time_us integer not null default 0;

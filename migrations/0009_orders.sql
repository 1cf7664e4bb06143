-- Orders of listings besides that of submission. A job that has not ended comes before all that have.
create index jobs_by_priority on jobs (priority, seq);
create index jobs_by_finished on jobs (ifnull(finished_at, 0), seq);

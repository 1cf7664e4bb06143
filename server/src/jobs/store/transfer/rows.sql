-- Rows in every table of SQLite, for the tests of transfers.

insert into studies (
    id, name, labels, seed, columns, key_columns, points, replicates, stop_when, queued, succeeded, runs, runs_time_s,
    created_at, updated_at, expires_at, submitted_by, owner, shared
) values
    ('s1', 'Größe ''1''', '{"a":"b"}', -1, '["/mix"]', '["mix"]', 2, 3, 'null', 1, 1, 1, 0.1, 1, 2, null, 'k', 'o', 1),
    ('s2', null, '{}', 9223372036854775807, '[]', '[]', 1, 1, 'null', 0, 0, 0, 0, 1, 2, 9, '', '', 0);
insert into study_parts (study, part, body) values (1, 0, '[1,2]'), (1, 1, '["é"]');
insert into study_requests (study, body, part, part_at, digest)
values (1, '{"template":{}}', 1, 12, -5), (2, '{"jobs":[]}', null, null, 9);
insert into study_labels (key, value, study) values ('a', 'b', 1), ('Ä', '', 2);
insert into study_points (study, point, key_values, stopped_early) values (1, 0, '["x"]', 2), (1, 1, '["y"]', 0);
insert into study_runs (study, point, replicate, outcome, facts, ended_at)
values (1, 0, 0, 'succeeded', '{"time_s":1e-300}', 3), (1, 1, 2, 'void', '{}', 4);
insert into study_keys (scope, key, body_sha256, study) values ('', 'key', 'ab', 1), ('o', 'key', 'cd', 2);

insert into jobs (
    id, state, name, labels, priority, seed, timeout_s, max_attempts, attempt_budget, cancel_requested, created_at,
    updated_at, lease_expires_at, engine, study, point, replicate, owner, shared, worker, worker_key, claim, threads,
    most_threads
) values
    ('j1', 'queued', 'Kies 日本 "?"', '{"a":"b"}', -5, -9223372036854775808, 1e-3, 3, 3, 0, 1, 1, null, 'e',
     null, null, null, '', 0, '', '', null, 64, 1),
    ('j2', 'running', null, '{}', 0, 1, 0.30000000000000004, 3, 3, 1, 2, 2, 77, 'e', 1, 0, 1, 'o', 1, 'w', 'k', 'c',
     null, 64),
    ('j3', 'succeeded', '', '{}', 0, 1, null, 3, 3, 0, 3, 3, null, 'e', 1, 0, 0, 'o', 0, '', '', null,
     null, 1),
    ('j4', 'failed', 'line' || char(10) || 'two', '{}', 0, 1, 86400, 3, 3, 0, 4, 4, null, 'e',
     null, null, null, 'p', 0, '', '', null, null, 1),
    ('j5', 'cancelled', '', '{}', 0, 1, null, 3, 3, 1, 5, 5, null, 'e', null, null, null, '', 0, '', '', null,
     null, 1),
    ('j6', 'queued', '', '{}', 0, 1, null, 3, 3, 0, 6, 6, null, 'e', null, null, null, '', 0, '', '', null,
     null, 1);
-- Two of them are longer than a page.
insert into job_requests (job, body, digest) values
    (1, '{"method":{"type":"rsa"},"s":"' || hex(zeroblob(5000000)) || '"}', 1),
    (2, '{"method":{"type":"edmd"},"s":"' || hex(zeroblob(5000000)) || '"}', -9223372036854775808),
    (3, '{"s":"\u0000"}', 0), (4, '{}', 0), (5, '{}', 0), (6, '{}', 0);
update jobs set method = 'rsa' where seq = 5;
insert into job_labels (key, value, job, state) values ('a', 'b', 1, 'queued'), ('a', 'B', 1, 'queued');
with recursive n (i) as (select 1 union all select i + 1 from n where i < 2500)
insert into job_labels (key, value, job, state) select 'label' || i % 7, 'value' || i, 4, 'failed' from n;
insert into idempotency_keys (scope, key, body_sha256, job) values ('', 'key', 'ab', 1), ('o', 'key', 'cd', 2);
delete from jobs where seq = 6;

insert into artifacts (job, attempt, path, bytes, sha256, report, report_digest, format_revision, format_lengths, owner)
values (3, 1, '20/j3.packstone', 1000000000000, 'ef', '{}', 7, 2, '{}', 'o');
insert into exports (
    id, job, key, type, options, kept, quick, rank, state, created_at, updated_at, used_at, owner, lease_expires_at
) values
    ('x1', 3, 'mesh', 'mesh', '{}', 1, 0, 0, 'queued', 1, 1, 1, 'o', null),
    ('x2', 3, 'slice', 'slice', '{}', 0, 1, 1, 'running', 1, 1, 1, 'o', 99);
update exports set state = 'succeeded', path = '20/x1.export', bytes = 17, sha256 = 'aa', report = '{}' where seq = 1;
insert into wrong_results (worker_key, worker, job, attempt, fault, at) values ('k', 'w 1', 'j2', 1, 'ä', 5);
insert into removals (path) values ('20/gone.export'), ('20/Gone.export'), ('20/é.export');

insert into queue_starts (owner, priority, turn) values ('', -5, 3), ('o', 0, 4);
insert into queue_owner_flows (owner, flow, priority, last_turn) values ('', 0, -5, 9), ('o', 1, 0, 12);
update queue_owners set last_start = 41 where owner = 'o';

insert into webhooks (job, study, url, host) values
    (1, null, 'https://example.org/?token=a', 'example.org'), (null, 1, 'https://example.org/b', 'example.org');
insert into webhook_deliveries (webhook, id, body, host, state, attempts, next_at, last_error, last_status, created_at)
values
    (1, 'm1', '{}', 'example.org', 'waiting', 2, 9, 'refused', 503, 1),
    (2, 'm2', '{}', 'example.org', 'failed', 0, 9, null, null, 1);

-- Failures: what ended a job or an export was stored as a problem document of the interface, with status and address. It is
-- now a failure: code, detail, faulty fields, figures. Numbers keep their text, because they stay JSON.

update jobs set error = json_object(
    'code', replace(replace(error ->> '$.type', '/problems/', ''), 'packing-not-reached', 'target-not-reached'),
    'detail', coalesce(error ->> '$.detail', ''),
    'fields', json(coalesce(error -> '$.errors', '[]')),
    'facts', json_remove(error, '$.type', '$.title', '$.status', '$.detail', '$.errors')
) where error is not null;

update exports set error = json_object(
    'code', replace(error ->> '$.type', '/problems/', ''),
    'detail', coalesce(error ->> '$.detail', ''),
    'fields', json(coalesce(error -> '$.errors', '[]')),
    'facts', json('{}')
) where error is not null;

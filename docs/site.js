// A page that was opened from disk may not read others, whose beginnings the search would show.
if (location.protocol === "file:") DOCUMENTATION_OPTIONS.SHOW_SEARCH_SUMMARY = false;

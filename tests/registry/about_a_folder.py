"""Tests of the registry that say nothing of a shared one, and why."""

_FILES = "it is about what SQLite, or the disk below it, does to a folder's own catalogue"
_OLD = "no shared registry is of an older form"
_READ_ONLY = "of a shared registry the rights are the server's: there is no copy of its catalogue to read"
_MARKER = "it is about what else may lie where a folder's registry is opened"
_HAND = "what lies in a bucket beside the registry's folders is not dynreg's, and nothing there is a link"
_LEDGER = "a shared catalogue decides what is stored: no page is taken over but by a repair"

_SEALS = "no look at a shared catalogue compares its rows with their seals: `verify` does"
_LINKS = "no object of a bucket is a link or a pipe"

_WHOLE = {"test_renewing.py": _OLD, "test_disk.py": _FILES}
_WHOLE |= {"test_crash_states.py": _FILES, "test_power_loss.py": _FILES}
_ALONE = {
    "test_migrations_lead_to_the_tables_of_the_code": _OLD,
    "test_names_of_a_registry_before_their_robots_were_kept_have_that_of_the_last_ingestion": _OLD,
    "test_registry_of_format_1_is_brought_up_to_date_and_keeps_its_content": _OLD,
    "test_failed_migration_changes_nothing": _OLD,
    "test_a_catalogue_of_format_1_with_a_row_that_nobody_wrote_is_refused_and_repaired": _OLD,
    "test_refused_openings": _MARKER,
    "test_a_lost_marker_is_written_anew": "a local folder that lost its marker is made again by `dynreg init`",
    "test_a_marker_of_an_endless_version_is_none": _MARKER,
    "test_an_empty_registry_whose_creation_was_cut_short_is_sound": _MARKER,
    "test_a_dry_run_leaves_a_registry_of_format_1_as_it_is": _OLD,
    "test_ten_thousand_flipped_bits": "a bucket takes an hour for as many; 40 are flipped there",
    "test_codes_of_sqlite_decide_what_is_said": _FILES,
    "test_nothing_is_put_into_a_catalogue_that_was_changed": _SEALS,
    "test_a_catalogue_that_nobody_else_writes_is_compared_with_its_seals_once": _SEALS,
    "test_pipes_and_links_among_the_files_are_faults_and_are_not_opened": _LINKS,
    "test_copies_that_were_put_together_keep_the_rows_of_both": "no copy of files is one of a server's rows",
    "test_two_repairs_do_not_run_at_once": "repairs of a shared registry take turns as its writers do",
    "test_a_catalogue_of_yesterday_follows_the_ledger": _LEDGER,
    "test_a_page_that_removes_is_followed": _LEDGER,
    "test_registry_without_write_access_can_be_read": _READ_ONLY,
    "test_a_mount_that_is_read_only_is_seen": _READ_ONLY,
    "test_no_room_for_the_copy_of_a_catalogue_is_told": _READ_ONLY,
    "test_a_copy_of_a_catalogue_that_is_written_meanwhile_is_made_again": _READ_ONLY,
    "test_gc_clears_copies_that_readers_left": _READ_ONLY,
    "test_gc_leaves_the_copy_of_a_reader_that_still_runs": _READ_ONLY,
    "test_a_catalogue_that_is_replaced_while_it_is_opened_is_opened_again": _FILES,
    "test_a_file_of_a_process_that_was_cut_short_is_synced_before_it_is_registered": _FILES,
    "test_folders_of_a_process_that_was_cut_short_are_synced_when_a_registry_is_opened": _FILES,
    "test_a_virtual_table_is_no_table_of_the_catalogue": _FILES,
    "test_damaged_page_of_the_catalogue_is_found": _FILES,
    "test_a_page_of_a_process_that_was_cut_short_is_synced_before_it_is_followed": _LEDGER,
    "test_a_page_of_another_ledger_does_not_follow": _LEDGER,
    "test_added_files_are_put_away": _HAND,
    "test_what_a_file_manager_leaves_is_no_fault_and_stays": _HAND,
}


def about_a_folder(file: str, test: str) -> str:
    """Why a test is about a registry in a folder alone; "" where it holds of a shared one, too."""
    return _WHOLE.get(file) or _ALONE.get(test, "")

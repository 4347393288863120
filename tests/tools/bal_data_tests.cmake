# bal_generate as a user runs it, the bundled problems, and bal_data/fetch.sh against a local server. A test that misses a program
# says which and counts as skipped (77).
add_test(NAME tools.bal_generate
  COMMAND sh ${CMAKE_CURRENT_LIST_DIR}/bal_generate_test.sh $<TARGET_FILE:bal_generate> ${PROJECT_SOURCE_DIR}/bal_data)
add_test(NAME bal_data.fetch
  COMMAND sh ${CMAKE_CURRENT_LIST_DIR}/fetch_test.sh ${PROJECT_SOURCE_DIR}/bal_data)
set_tests_properties(tools.bal_generate bal_data.fetch PROPERTIES LABELS tools SKIP_RETURN_CODE 77)

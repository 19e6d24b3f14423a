"""The zips, and the installed extension in the bpy module, each time in processes and a user folder of its own."""

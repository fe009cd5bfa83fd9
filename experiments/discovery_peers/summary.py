"""The results of each method over all sets, and the sets on which a general method is better."""

import pandas as pd

#: This project's own discovery, beside the peers.
THIS = "discovery"

#: A removed share counts as better only if it is larger by at least this.
BETTER = 0.05


def summarised(rows: pd.DataFrame) -> pd.DataFrame:
    """One row for each method: shares removed, names right and false, harm done, seconds a set."""
    table = []
    for method in dict.fromkeys(rows["method"]):
        own = rows[rows["method"] == method]
        null = own["planted"] == "nothing"
        real = own[~null]
        removed = real["removed"].dropna()
        table.append(
            {
                "method": method,
                "sets": len(real),
                "hidden": int(real["hidden"].sum()),
                "hidden_named": int(real["named"].sum()),
                "removed_median": removed.median(),
                "removed_lower_quartile": removed.quantile(0.25),
                "removed_lowest_decile": removed.quantile(0.1),
                "removed_90": int((removed >= 0.9).sum()),
                "removed_of": len(removed),
                "sets_with_false_name": int((real["false_names"] > 0).sum()),
                "nulls": int(null.sum()),
                "nulls_with_name": int((own[null]["false_names"] > 0).sum()),
                "worse": int(real["worse"].sum()),
                "nulls_worse": int(own[null]["worse"].sum()),
                "seconds_median": own["seconds"].median(),
            }
        )
    return pd.DataFrame(table)


def beaten(rows: pd.DataFrame) -> pd.DataFrame:
    """Sets on which a general method removes clearly more than the discovery, and by how much."""
    removed = rows.pivot_table(index=["set", "planted"], columns="method", values="removed")
    if THIS not in removed:
        return pd.DataFrame()
    others = removed.drop(columns=THIS)
    lost = others.max(axis=1) > removed[THIS] + BETTER
    return pd.DataFrame(
        {
            THIS: removed.loc[lost, THIS],
            "removed": others[lost].max(axis=1),
            "by": others[lost].idxmax(axis=1) if lost.any() else "",
        }
    ).reset_index()

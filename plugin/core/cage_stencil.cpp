#include "core/cage_stencil.h"

#include <algorithm>
#include <limits>
#include <stdexcept>

namespace isolux {

void CageStencil::AddWithWeight(const CageStencil& other, double weight) {
    if (weight != 0.0) {
        for (const Term& term : other.terms_) {
            terms_.push_back({term.column, term.weight * weight});
        }
    }
}

void CageStencil::gather() {
    std::ranges::stable_sort(terms_, {}, &Term::column);
    std::size_t kept = 0;
    for (std::size_t i = 0; i < terms_.size(); ++i) {
        if (kept > 0 && terms_[kept - 1].column == terms_[i].column) {
            terms_[kept - 1].weight += terms_[i].weight;
        } else {
            terms_[kept++] = terms_[i];
        }
    }
    terms_.resize(kept);
    terms_.shrink_to_fit();
}

void CageStencil::append_to(SparseRows& rows) const {
    for (const Term& term : terms_) {
        rows.columns.push_back(term.column);
        rows.weights.push_back(term.weight);
    }
    if (rows.columns.size() > std::numeric_limits<std::int32_t>::max()) {
        throw std::length_error("more stencil weights than an int32 counts");
    }
    rows.begin.push_back(static_cast<std::int32_t>(rows.columns.size()));
}

std::vector<CageStencil> unit_stencils(std::int32_t count) {
    std::vector<CageStencil> units;
    units.reserve(count);
    for (std::int32_t i = 0; i < count; ++i) {
        units.emplace_back(i);
    }
    return units;
}

SparseRows sparse_rows(const std::vector<CageStencil>& stencils) {
    SparseRows rows;
    rows.begin.reserve(stencils.size() + 1);
    rows.begin.push_back(0);
    for (const CageStencil& stencil : stencils) {
        stencil.append_to(rows);
    }
    return rows;
}

} // namespace isolux
